#include "idol/io/bag_recording.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "idol/io/bag_messages.hpp"
#include "idol/io/choose_stream.hpp"
#include "idol/io/ros_types.hpp"

namespace idol {
namespace {

constexpr const char* kDamagedMessage = "the message is damaged: ";

/// The messages of one topic, decoded.
template <class Row>
class BagSource : public RowSource<Row> {
 public:
  BagSource(std::shared_ptr<const BagFile> bag, const BagTopic& topic)
      : bag_(std::move(bag)),
        messages_(*bag_, topic.connections),
        name_(fmt::format("{}: {}", bag_->file().name(), topic.name)) {}

  std::span<const Row> read() override {
    rows_.clear();
    BagMessages::Message message;
    while (rows_.empty() && messages_.next(message)) {
      try {
        decode(message.data, rows_);
      } catch (const BadBytes& e) {
        throw DataError(fmt::format("{}: {}{}", where(0), kDamagedMessage, e.why));
      } catch (const UnknownFormat& e) {
        throw DataError(fmt::format("{}: {}", where(0), e.what()));
      }
    }
    return rows_;
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::string where(std::size_t i) const override {
    return fmt::format("{}, byte {}{}", name_, messages_.place(), i > 0 ? fmt::format(", row {}", i) : "");
  }
  [[nodiscard]] double progress() const override { return messages_.progress(); }

 protected:
  virtual void decode(Bytes message, std::vector<Row>& rows) = 0;

 private:
  std::shared_ptr<const BagFile> bag_;
  BagMessages messages_;
  std::string name_;
  std::vector<Row> rows_;
};

class EventSource : public BagSource<Event> {
 public:
  EventSource(const std::shared_ptr<const BagFile>& bag, const BagTopic& topic, Diagnostics& diagnostics)
      : BagSource(bag, topic), decoder_(topic.type) {
    if (topic.type == "event_camera_msgs/EventPacket") find_clock(*bag, topic, diagnostics);
  }

 protected:
  void decode(Bytes message, std::vector<Event>& rows) override { decoder_.decode(message, rows); }

 private:
  // In a pass of its own over the first messages.
  void find_clock(const BagFile& bag, const BagTopic& topic, Diagnostics& diagnostics) {
    constexpr int kMessages = 200;
    SensorClock clock;
    try {
      BagMessages messages(bag, topic.connections);
      BagMessages::Message message;
      for (int i = 0; i < kMessages && messages.next(message); ++i)
        EventMessageDecoder::add_to_clock(message.data, clock);
    } catch (const DataError&) {
    } catch (const BadBytes&) {
      // The pass that matters comes to the same place, and says so.
    }
    if (!clock.known()) return;
    decoder_.set_clock(clock);
    if (const auto off = clock.disagreement(); off.messages > 0)
      diagnostics.warn(
          "message_stamps",
          fmt::format("{}: a message is stamped up to {:.3f} s from where the sensor's clock is by the "
                      "others; the sensor's clock is taken",
                      name(), off.most_s),
          off.messages);
  }

  EventMessageDecoder decoder_;
};

class ImuSource : public BagSource<ImuSample> {
 public:
  ImuSource(std::shared_ptr<const BagFile> bag, const BagTopic& topic, ImuPart part, Diagnostics& diagnostics)
      : BagSource(std::move(bag), topic), part_(part), diagnostics_(diagnostics) {}

 protected:
  void decode(Bytes message, std::vector<ImuSample>& rows) override {
    bool doubtful = false;
    rows.push_back(decode_imu(message, part_, &doubtful));
    if (doubtful)
      diagnostics_.warn(
          "imu_not_provided",
          fmt::format("{}: the message says that it has no such readings (covariance -1), but they are not "
                      "zero; they are used",
                      where(0)));
  }

 private:
  ImuPart part_;
  Diagnostics& diagnostics_;
};

/// Accelerations and rates of two topics: a sample at each rate's stamp, the acceleration between its
/// neighbours.
class TwoTopicImuSource : public RowSource<ImuSample> {
 public:
  TwoTopicImuSource(std::unique_ptr<ImuSource> accel, std::unique_ptr<ImuSource> gyro)
      : accel_(std::move(accel)), gyro_(std::move(gyro)) {}

  std::span<const ImuSample> read() override {
    while (true) {
      const auto rates = gyro_->read();
      if (rates.empty()) return {};
      sample_ = rates.front();  // a message, a sample
      while (!after_ || after_->t < sample_.t) {
        const auto next = accel_->read();
        if (next.empty()) return {};
        before_ = std::exchange(after_, next.front());
      }
      if (!before_) continue;
      const double span = seconds_between(before_->t, after_->t);
      const double share = span > 0 ? seconds_between(before_->t, sample_.t) / span : 1;
      sample_.accel = (1 - share) * before_->accel + share * after_->accel;
      return {&sample_, 1};
    }
  }
  [[nodiscard]] const std::string& name() const override { return gyro_->name(); }
  [[nodiscard]] std::string where(std::size_t i) const override { return gyro_->where(i); }
  [[nodiscard]] double progress() const override { return gyro_->progress(); }

 private:
  std::unique_ptr<ImuSource> accel_, gyro_;
  std::optional<ImuSample> before_, after_;  // accelerations around the rate
  ImuSample sample_;
};

class BagFrames : public FrameSource {
 public:
  BagFrames(std::shared_ptr<const BagFile> bag, const BagTopic& topic)
      : bag_(std::move(bag)), messages_(*bag_, topic.connections), name_(topic.name) {}

  bool next(Frame& frame) override {
    BagMessages::Message message;
    if (!messages_.next(message)) return false;
    try {
      decode_image(message.data, frame);
    } catch (const BadBytes& e) {
      throw DataError(
          fmt::format("{}: {}: {}{}", bag_->file().where(messages_.place()), name_, kDamagedMessage, e.why));
    } catch (const UnknownFormat& e) {
      throw DataError(fmt::format("{}: {}: {}", bag_->file().where(messages_.place()), name_, e.what()));
    }
    return true;
  }

 private:
  std::shared_ptr<const BagFile> bag_;
  BagMessages messages_;
  std::string name_;
};

}  // namespace

BagRecording::BagRecording(const std::filesystem::path& path, StreamChoice choice)
    : bag_(std::make_shared<BagFile>(path)), choice_(std::move(choice)) {}

const BagTopic* BagRecording::choose(bool (*wanted)(std::string_view), const std::string& name,
                                     const char* kind, const char* option) const {
  std::vector<const BagTopic*> topics;
  std::vector<std::string> names;
  for (const BagTopic& topic : bag_->topics()) {
    if (!wanted(topic.type) || topic.messages == 0) continue;
    topics.push_back(&topic);
    names.push_back(topic.name);
  }
  const auto chosen = choose_stream(bag_->file().name(), kind, option, names, name);
  if (!chosen) return nullptr;
  const BagTopic& topic = *topics[*chosen];
  if (const std::string other = other_definition(topic.type, topic.md5sum, topic.definition); !other.empty())
    throw DataError(fmt::format("{}: {}: {}", bag_->file().name(), topic.name, other));
  return &topic;
}

bool BagRecording::has_events() const {
  return std::any_of(bag_->topics().begin(), bag_->topics().end(),
                     [](const BagTopic& t) { return is_event_type(t.type) && t.messages != 0; });
}

bool BagRecording::has_imu() const {
  return std::any_of(bag_->topics().begin(), bag_->topics().end(),
                     [](const BagTopic& t) { return is_imu_type(t.type) && t.messages != 0; });
}

std::unique_ptr<RowSource<Event>> BagRecording::events(Diagnostics& diagnostics) {
  const BagTopic* topic = choose(is_event_type, choice_.events, "topics with events", "--events-topic");
  warn_of_damage(diagnostics);
  if (topic != nullptr) return std::make_unique<EventSource>(bag_, *topic, diagnostics);
  std::vector<std::string> there;
  for (const BagTopic& t : bag_->topics()) there.push_back(fmt::format("{} ({})", t.name, t.type));
  throw DataError(fmt::format(
      "{}: no topic with events (dvs_msgs/EventArray, prophesee_event_msgs/EventArray or "
      "event_camera_msgs/EventPacket); there is {}",
      bag_->file().name(), there.empty() ? "nothing" : fmt::format("{}", fmt::join(there, ", "))));
}

std::unique_ptr<RowSource<ImuSample>> BagRecording::imu(Diagnostics& diagnostics) {
  constexpr const char* kKind = "topics with IMU data";
  constexpr const char* kOption = "--imu-topic";
  warn_of_damage(diagnostics);
  if (const auto comma = choice_.imu.find(','); comma != std::string::npos) {
    const auto open = [&](const std::string& name, ImuPart part) {
      const BagTopic* topic = name.empty() ? nullptr : choose(is_imu_type, name, kKind, kOption);
      if (topic == nullptr)
        throw UsageError(
            fmt::format("--imu-topic {}: two topics are expected, ACCEL,GYRO", printable(choice_.imu)));
      return std::make_unique<ImuSource>(bag_, *topic, part, diagnostics);
    };
    return std::make_unique<TwoTopicImuSource>(open(choice_.imu.substr(0, comma), ImuPart::kAccel),
                                               open(choice_.imu.substr(comma + 1), ImuPart::kGyro));
  }
  const BagTopic* topic = choose(is_imu_type, choice_.imu, kKind, kOption);
  if (topic != nullptr) return std::make_unique<ImuSource>(bag_, *topic, ImuPart::kBoth, diagnostics);
  throw DataError(fmt::format("{}: no topic with IMU data (sensor_msgs/Imu)", bag_->file().name()));
}

std::optional<Trajectory> BagRecording::groundtruth() {
  const BagTopic* topic = choose(is_pose_type, choice_.truth, "topics with poses", "--truth-topic");
  if (topic == nullptr) return std::nullopt;
  BagMessages messages(*bag_, topic->connections);
  Trajectory trajectory;
  lost_poses_ = 0;
  for (BagMessages::Message message; messages.next(message);) {
    try {
      bool lost = false;
      const StampedPose pose = decode_pose(message.data, topic->type, &lost);
      lost_poses_ += lost ? 1 : 0;
      if (lost) continue;
      if (trajectory.empty() || pose.t > trajectory.back().t) trajectory.push_back(pose);
    } catch (const BadBytes& e) {
      throw DataError(fmt::format("{}: {}: {}{}", bag_->file().where(messages.place()), topic->name,
                                  kDamagedMessage, e.why));
    }
  }
  if (trajectory.empty()) return std::nullopt;
  return trajectory;
}

std::unique_ptr<FrameSource> BagRecording::frames() {
  for (const BagTopic& topic : bag_->topics())
    if (is_image_type(topic.type) && topic.messages != 0 &&
        other_definition(topic.type, topic.md5sum, topic.definition).empty())
      return std::make_unique<BagFrames>(bag_, topic);
  return nullptr;
}

std::vector<StreamInfo> BagRecording::streams() {
  std::vector<StreamInfo> found;
  for (const BagTopic& t : bag_->topics()) found.push_back({t.name, t.type, t.messages});
  return found;
}

Recording::Resolution BagRecording::resolution() {
  BagMessages::Message message;
  try {
    const BagTopic* topic = choose(is_event_type, choice_.events, "topics with events", "--events-topic");
    if (topic == nullptr) return {};
    BagMessages messages(*bag_, topic->connections);
    if (!messages.next(message)) return {};
    EventMessageDecoder decoder(topic->type);
    std::vector<Event> events;
    decoder.decode(message.data, events);
    constexpr std::uint32_t kLargest = 1 << 16;
    if (decoder.width() > kLargest || decoder.height() > kLargest) return {};
    return {static_cast<int>(decoder.width()), static_cast<int>(decoder.height())};
  } catch (const DataError&) {
  } catch (const BadBytes&) {
    // Whoever reads the events will hear of it.
  }
  return {};
}

void BagRecording::warn_of_damage(Diagnostics& diagnostics) const {
  if (!bag_->indexed() && !diagnostics.entries().contains("bag_without_index"))
    diagnostics.warn(
        "bag_without_index",
        fmt::format("{}: the bag has no index: its recorder was not stopped properly, or it is cut "
                    "off ('rosbag reindex' mends the former)",
                    bag_->file().name()));
}

}  // namespace idol
