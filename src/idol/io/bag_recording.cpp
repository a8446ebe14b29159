#include "idol/io/bag_recording.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

#include "idol/io/bag_messages.hpp"
#include "idol/io/choose_stream.hpp"

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
  EventSource(std::shared_ptr<const BagFile> bag, const BagTopic& topic)
      : BagSource(std::move(bag), topic), decoder_(topic.type) {}

 protected:
  void decode(Bytes message, std::vector<Event>& rows) override { decoder_.decode(message, rows); }

 private:
  EventMessageDecoder decoder_;
};

class ImuSource : public BagSource<ImuSample> {
 public:
  using BagSource::BagSource;

 protected:
  void decode(Bytes message, std::vector<ImuSample>& rows) override { rows.push_back(decode_imu(message)); }
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
  return chosen ? topics[*chosen] : nullptr;
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
  if (topic != nullptr) return std::make_unique<EventSource>(bag_, *topic);
  std::vector<std::string> there;
  for (const BagTopic& t : bag_->topics()) there.push_back(fmt::format("{} ({})", t.name, t.type));
  throw DataError(fmt::format(
      "{}: no topic with events (dvs_msgs/EventArray, prophesee_event_msgs/EventArray or "
      "event_camera_msgs/EventPacket); there is {}",
      bag_->file().name(), there.empty() ? "nothing" : fmt::format("{}", fmt::join(there, ", "))));
}

std::unique_ptr<RowSource<ImuSample>> BagRecording::imu(Diagnostics& diagnostics) {
  const BagTopic* topic = choose(is_imu_type, choice_.imu, "topics with IMU data", "--imu-topic");
  warn_of_damage(diagnostics);
  if (topic != nullptr) return std::make_unique<ImuSource>(bag_, *topic);
  throw DataError(fmt::format("{}: no topic with IMU data (sensor_msgs/Imu)", bag_->file().name()));
}

std::optional<Trajectory> BagRecording::groundtruth() {
  const BagTopic* topic = choose(is_pose_type, choice_.truth, "topics with poses", "--truth-topic");
  if (topic == nullptr) return std::nullopt;
  BagMessages messages(*bag_, topic->connections);
  Trajectory trajectory;
  for (BagMessages::Message message; messages.next(message);) {
    try {
      const StampedPose pose = decode_pose(message.data, topic->type);
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
    if (is_image_type(topic.type) && topic.messages != 0) return std::make_unique<BagFrames>(bag_, topic);
  return nullptr;
}

std::vector<StreamInfo> BagRecording::streams() {
  std::vector<StreamInfo> found;
  for (const BagTopic& t : bag_->topics()) found.push_back({t.name, t.type, t.messages});
  return found;
}

Recording::Resolution BagRecording::resolution() {
  const BagTopic* topic = choose(is_event_type, choice_.events, "topics with events", "--events-topic");
  BagMessages::Message message;
  if (topic == nullptr) return {};
  try {
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
