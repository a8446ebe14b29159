#include "idol/io/text_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>

#include "idol/io/sequence_files.hpp"

namespace idol {

namespace fs = std::filesystem;

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

template <class Parser>
void TextReader::Cursor<Parser>::advance() {
  typename Parser::Row row;
  head.reset();
  try {
    if (stream.next(row)) head = row;
  } catch (const DataError&) {
    damage = std::current_exception();
  }
}

template <class Parser>
std::unique_ptr<TextReader::Cursor<Parser>> TextReader::open(const fs::path& file, Parser parser) {
  auto cursor = std::unique_ptr<Cursor<Parser>>(new Cursor<Parser>{{file, parser, diagnostics_}, {}, {}});
  cursor->advance();
  if (!cursor->head) {
    if (cursor->damage) std::rethrow_exception(cursor->damage);
    throw DataError(fmt::format("{}: holds no {} at all", file.string(), Parser::kName));
  }
  return cursor;
}

template <class Parser>
std::unique_ptr<TextReader::Cursor<Parser>> TextReader::open(const fs::path& folder, const std::string& name,
                                                             Parser parser) {
  const auto files = find_stream_files(folder, name);
  if (files.empty()) {
    throw DataError(
        fmt::format("{}: no {} in this folder (nor {}.gz, {}.zst)", folder.string(), name, name, name));
  }
  if (files.size() > 1) {
    diagnostics_.warn("several_files", fmt::format("{}: read; {} lies beside it and is ignored",
                                                   files[0].string(), files[1].filename().string()));
  }
  return open(files[0], parser);
}

TextReader::TextReader(const fs::path& path, const ReaderOptions& options)
    : options_(options), imu_offset_(from_seconds(options.imu_offset_s)) {
  if (!(options.from_s >= 0) || !(options.to_s > options.from_s)) {
    throw UsageError(fmt::format("the span to read, {} to {} s, is empty or begins before the recording",
                                 options.from_s, options.to_s));
  }
  const EventParser parser(options.width, options.height);
  const fs::path folder = sequence_folder(path);
  events_ = fs::is_directory(path) ? open(path, "events.txt", parser) : open(path, parser);
  const bool imu_there = !find_stream_files(folder, "imu.txt").empty();
  if (options.need_imu || (options.imu_if_present && imu_there)) imu_ = open(folder, "imu.txt", ImuParser());

  first_stamp_ = events_->head->t;
  if (imu_) {
    first_stamp_ = std::min(first_stamp_, imu_->head->t);
  } else if (imu_there) {
    // Not read, but a span means the same part of the recording with and without it.
    try {
      Diagnostics unheard;
      ImuSample sample;
      RowStream<ImuParser> peek(find_stream_files(folder, "imu.txt")[0], {}, unheard);
      if (peek.next(sample)) first_stamp_ = std::min(first_stamp_, sample.t);
    } catch (const DataError&) {
      // Whoever wants the IMU will hear of it.
    }
  }
  begin_ = saturated_sum(first_stamp_, options.from_s);
  end_ = saturated_sum(first_stamp_, options.to_s);
}

void TextReader::fill_events() {
  if (events_over_) return;
  auto& head = events_->head;
  while (head && head->t < end_ && waiting_.size() < options_.packet_events) {
    if (head->t >= begin_) waiting_.push_back(*head);
    events_->advance();
  }
  if (!waiting_.empty()) {
    if (!first_event_) first_event_ = waiting_.front().t;
    last_event_ = waiting_.back().t;
  }
  if (!head || head->t >= end_) events_over_ = true;
}

Time TextReader::imu_begin() const {
  return (options_.imu_near_events ? std::max(begin_, *first_event_) : begin_) - kImuMargin;
}

Time TextReader::imu_end() const {
  return (options_.imu_near_events && events_over_ ? std::min(end_, last_event_ + 1) : end_) + kImuMargin;
}

/// Appends the samples up to the first one after `until`; false if the packet is full before.
bool TextReader::fill_imu(std::vector<ImuSample>& imu, Time until) {
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

std::string TextReader::span_of_events() const {
  return fmt::format("{} has events of {:.6f} to {:.6f} s", events_->name(), seconds_of(*first_event_),
                     seconds_of(last_event_));
}

void TextReader::check_overlap() const {
  if (imu_->damage || !first_event_) return;
  const char* advice = "the streams do not overlap in time; are both of one recording and one clock?";
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

std::optional<Packet> TextReader::end() const {
  if (events_->damage) std::rethrow_exception(events_->damage);
  events_->stream.check_share();
  if (imu_) imu_->stream.check_share();
  if (!first_event_) {
    throw DataError(fmt::format(
        "{}: no events between {} and {} s after the recording's first stamp; choose another span",
        events_->name(), options_.from_s, options_.to_s));
  }
  return std::nullopt;
}

std::optional<Packet> TextReader::next() {
  if (imu_ && imu_->damage && waiting_.empty()) std::rethrow_exception(imu_->damage);
  if (waiting_.empty()) fill_events();
  if (!first_event_) return end();
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

double TextReader::progress() const {
  const double bytes = events_->stream.lines().progress();
  if (events_over_) return 1.0;
  const double span = seconds_between(begin_, end_);
  const double done = events_->head ? seconds_between(begin_, events_->head->t) : 0.0;
  return std::clamp(std::max(bytes, done / span), 0.0, 1.0);
}

}  // namespace idol
