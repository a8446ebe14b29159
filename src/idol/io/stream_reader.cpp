#include "idol/io/stream_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

namespace idol {

namespace {

constexpr std::size_t kMostImuPerPacket = 16384;
// IMU samples around a cut span that are delivered too, so that the representation covers its borders [ns].
constexpr Time kImuMargin = 100'000'000;

Time saturated_sum(Time t, double seconds) {
  const double sum = static_cast<double>(t) + seconds * kNsPerS;
  constexpr double kLimit = 9.2e18;
  if (sum > kLimit) return std::numeric_limits<Time>::max() - kImuMargin;
  return t + from_seconds(seconds);
}

double seconds_of(Time t) { return static_cast<double>(t) / kNsPerS; }

}  // namespace

template <class Row>
void StreamReader::Cursor<Row>::advance() {
  Row row;
  head.reset();
  try {
    if (stream.next(row)) head = row;
  } catch (const DataError&) {
    damage = std::current_exception();
  }
}

template <>
std::unique_ptr<RowSource<Event>> StreamReader::source(Diagnostics& diagnostics) {
  return recording_->events(diagnostics);
}
template <>
std::unique_ptr<RowSource<ImuSample>> StreamReader::source(Diagnostics& diagnostics) {
  return recording_->imu(diagnostics);
}

/// In a pass of its own over the first rows.
template <class Row>
std::size_t StreamReader::find_rows_before_clock(const InputCheck<Row>& check, Diagnostics& diagnostics) {
  try {
    Diagnostics unheard;
    const auto rows = source<Row>(unheard);
    const auto before = rows_before_clock(*rows, check);
    if (!before) return 0;
    diagnostics.warn(
        "stamps_before_clock",
        fmt::format("{}: the first {} rows are stamped {:.6f} to {:.6f} s, before the clock was set to "
                    "{:.6f} s; rows dropped",
                    rows->name(), before->rows, seconds_of(before->first), seconds_of(before->last),
                    seconds_of(before->next)),
        static_cast<std::int64_t>(before->rows));
    return before->rows;
  } catch (const DataError&) {
    return 0;  // the pass that matters comes to the same place, and says so
  }
}

template <class Row>
std::unique_ptr<StreamReader::Cursor<Row>> StreamReader::open(std::unique_ptr<RowSource<Row>> source,
                                                              InputCheck<Row> check) {
  const std::size_t skip = find_rows_before_clock(check, diagnostics_);
  auto cursor =
      std::unique_ptr<Cursor<Row>>(new Cursor<Row>{{std::move(source), check, diagnostics_, skip}, {}, {}});
  cursor->advance();
  if (!cursor->head) {
    if (cursor->damage) std::rethrow_exception(cursor->damage);
    throw DataError(fmt::format("{}: holds no {} at all", cursor->name(), InputCheck<Row>::kName));
  }
  return cursor;
}

StreamReader::StreamReader(std::unique_ptr<Recording> recording, const ReaderOptions& options)
    : options_(options), recording_(std::move(recording)), imu_offset_(from_seconds(options.imu_offset_s)) {
  if (!(options.from_s >= 0) || !(options.to_s > options.from_s)) {
    throw UsageError(fmt::format("the span to read, {} to {} s, is empty or begins before the recording",
                                 options.from_s, options.to_s));
  }
  open_streams();
  begin_ = saturated_sum(first_stamp_, options.from_s);
  end_ = saturated_sum(first_stamp_, options.to_s);
  events_over_ = !events_;
}

void StreamReader::open_streams() {
  if (options_.need_events || recording_->has_events()) {
    events_ = open(recording_->events(diagnostics_), InputCheck<Event>(options_.width, options_.height));
    check_resolution();
  }
  if (options_.need_imu || !events_ || (options_.imu_if_present && recording_->has_imu()))
    imu_ = open(recording_->imu(diagnostics_), InputCheck<ImuSample>());

  first_stamp_ = events_ ? events_->head->t : imu_->head->t;
  if (imu_) {
    first_stamp_ = std::min(first_stamp_, imu_->head->t);
  } else if (recording_->has_imu()) {
    // Not read, but a span means the same part of the recording with and without it.
    try {
      Diagnostics unheard;
      ImuSample sample;
      ImuStream peek(recording_->imu(unheard), {}, unheard,
                     find_rows_before_clock(InputCheck<ImuSample>(), unheard));
      if (peek.next(sample)) first_stamp_ = std::min(first_stamp_, sample.t);
    } catch (const DataError&) {
      // Whoever wants the IMU will hear of it.
    } catch (const UsageError&) {
      // Several of them: none is wanted.
    }
  }
}

void StreamReader::check_resolution() {
  const auto [width, height] = recording_->resolution();
  if (width <= 0 || height <= 0 || options_.width <= 0 || options_.height <= 0) return;
  if (width == options_.width && height == options_.height) return;
  diagnostics_.warn("other_resolution",
                    fmt::format("{}: recorded with {} x {} pixels, but the calibration is for {} x {}",
                                events_->name(), width, height, options_.width, options_.height));
}

void StreamReader::fill_events() {
  if (events_over_) return;
  auto& head = events_->head;
  while (head && head->t < end_ && waiting_.size() < options_.packet_events) {
    if (head->t >= begin_) {
      waiting_.push_back(*head);
      events_->stream.next_plain(waiting_, options_.packet_events - waiting_.size(), end_);
    }
    events_->advance();
  }
  if (!waiting_.empty()) {
    if (!first_event_) first_event_ = waiting_.front().t;
    last_event_ = waiting_.back().t;
  }
  if (!head || head->t >= end_) events_over_ = true;
}

Time StreamReader::imu_begin() const {
  return (options_.imu_near_events && first_event_ ? std::max(begin_, *first_event_) : begin_) - kImuMargin;
}

Time StreamReader::imu_end() const {
  return (options_.imu_near_events && first_event_ && events_over_ ? std::min(end_, last_event_ + 1) : end_) +
         kImuMargin;
}

/// Appends the samples up to the first one after `until`; false if the packet is full before.
bool StreamReader::fill_imu(std::vector<ImuSample>& imu, Time until) {
  while (imu_->head && (!first_imu_ || last_imu_ <= until)) {
    const Time t = imu_->head->t - imu_offset_;
    if (t >= imu_end()) break;
    if (imu.size() == kMostImuPerPacket) return false;
    last_imu_ = t;
    if (t >= imu_begin()) {
      if (!first_imu_) first_imu_ = t;
      imu.push_back(*imu_->head);
    }
    imu_->advance();
  }
  return true;
}

std::string StreamReader::span_of_events() const {
  return fmt::format("{} has events of {:.6f} to {:.6f} s", events_->name(), seconds_of(*first_event_),
                     seconds_of(last_event_));
}

void StreamReader::check_overlap() const {
  if (imu_->damage || !first_event_) return;
  std::string advice = "the streams do not overlap in time; are both of one recording and one clock?";
  if (std::abs(options_.imu_offset_s) > 0.01)
    advice = fmt::format("with the rig's time shift of {:.3f} s (t_imu = t_camera + shift) {}",
                         options_.imu_offset_s, advice);
  if (!imu_->head && (!first_imu_ || last_imu_ < *first_event_)) {
    throw DataError(fmt::format("{}, but {} ends before that, at {:.6f} s; {}", span_of_events(),
                                imu_->name(), seconds_of(last_imu_ + imu_offset_), advice));
  }
  if (!events_over_) return;
  const Time first = first_imu_ ? *first_imu_ : imu_->head->t - imu_offset_;
  if (first > last_event_) {
    throw DataError(fmt::format("{}, but {} begins after that, at {:.6f} s; {}", span_of_events(),
                                imu_->name(), seconds_of(first + imu_offset_), advice));
  }
}

std::optional<Packet> StreamReader::end() const {
  if (events_ && events_->damage) std::rethrow_exception(events_->damage);
  if (imu_ && imu_->damage) std::rethrow_exception(imu_->damage);
  if (events_) events_->stream.check_share();
  if (imu_) imu_->stream.check_share();
  if (events_ ? !first_event_ : !first_imu_) {
    throw DataError(
        fmt::format("{}: no {} between {} and {} s after the recording's first stamp; choose "
                    "another span",
                    events_ ? events_->name() : imu_->name(), events_ ? "events" : "IMU samples",
                    options_.from_s, options_.to_s));
  }
  return std::nullopt;
}

std::optional<Packet> StreamReader::next() {
  if (imu_ && imu_->damage && waiting_.empty()) std::rethrow_exception(imu_->damage);
  if (waiting_.empty()) fill_events();
  if (events_ && !first_event_) return end();
  Packet packet;
  if (imu_) {
    const Time until = waiting_.empty() ? std::numeric_limits<Time>::max() : waiting_.back().t;
    if (!fill_imu(packet.imu, until)) return packet;
    check_overlap();
  }
  packet.events = std::move(waiting_);
  waiting_.clear();
  if (packet.events.empty() && packet.imu.empty()) return end();
  return packet;
}

double StreamReader::progress() const {
  if (!events_) return imu_->stream.place().progress();
  const double bytes = events_->stream.place().progress();
  if (events_over_) return 1.0;
  const double span = seconds_between(begin_, end_);
  const double done = events_->head ? seconds_between(begin_, events_->head->t) : 0.0;
  return std::clamp(std::max(bytes, done / span), 0.0, 1.0);
}

}  // namespace idol
