#include "idol/io/chained_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

template <class Row>
std::unique_ptr<RowSource<Row>> source_of(Recording& part, Diagnostics& diagnostics);
template <>
std::unique_ptr<RowSource<Event>> source_of(Recording& part, Diagnostics& diagnostics) {
  return part.events(diagnostics);
}
template <>
std::unique_ptr<RowSource<ImuSample>> source_of(Recording& part, Diagnostics& diagnostics) {
  return part.imu(diagnostics);
}

/// The first stamp of a stream; beyond all others if there is none.
template <class Row>
Time first_stamp(Recording& part) {
  try {
    Diagnostics unheard;
    const auto source = source_of<Row>(part, unheard);
    if (const auto rows = source->read(); !rows.empty()) return rows.front().t;
  } catch (const DataError&) {
    // Whoever reads it will hear of it.
  }
  return kLargestStamp;
}

template <class Row>
class ChainedSource : public RowSource<Row> {
 public:
  ChainedSource(std::vector<std::unique_ptr<RowSource<Row>>> sources, Diagnostics& diagnostics)
      : sources_(std::move(sources)), diagnostics_(diagnostics) {}

  std::span<const Row> read() override {
    while (true) {
      std::span<const Row> rows = sources_[part_]->read();
      if (rows.empty()) {
        if (sources_[part_]->odd().status != RowStatus::kGood || part_ + 1 == sources_.size()) return {};
        ++part_;
        repeats_ = true;
        continue;
      }
      skipped_ = 0;
      if (repeats_) {
        const auto fresh =
            std::find_if(rows.begin(), rows.end(), [&](const Row& row) { return row.t > last_; });
        skipped_ = static_cast<std::size_t>(fresh - rows.begin());
        repeats_ = fresh == rows.end();
        if (skipped_ > 0)
          diagnostics_.warn(
              "overlapping_files",
              fmt::format("{}: begins before the file before it ends; what is there twice is left out",
                          sources_[part_]->name()),
              static_cast<std::int64_t>(skipped_));
        rows = rows.subspan(skipped_);
        if (rows.empty()) continue;
      }
      last_ = rows.back().t;
      return rows;
    }
  }
  [[nodiscard]] const RowResult& odd() const override { return sources_[part_]->odd(); }
  [[nodiscard]] const std::string& name() const override { return sources_[part_]->name(); }
  [[nodiscard]] std::string where(std::size_t i) const override {
    return sources_[part_]->where(i + skipped_);
  }
  [[nodiscard]] double progress() const override {
    return (static_cast<double>(part_) + sources_[part_]->progress()) / static_cast<double>(sources_.size());
  }

 private:
  std::vector<std::unique_ptr<RowSource<Row>>> sources_;
  Diagnostics& diagnostics_;
  std::size_t part_ = 0, skipped_ = 0;  // rows of the last piece before those given out
  bool repeats_ = false;                // the part's beginning may have been in the one before
  Time last_ = 0;
};

template <class Row>
std::unique_ptr<RowSource<Row>> chain(const std::vector<std::unique_ptr<Recording>>& parts,
                                      bool (Recording::*has)() const, Diagnostics& diagnostics) {
  std::vector<std::unique_ptr<RowSource<Row>>> sources;
  for (const auto& part : parts)
    if ((part.get()->*has)()) sources.push_back(source_of<Row>(*part, diagnostics));
  if (sources.empty()) return source_of<Row>(*parts[0], diagnostics);  // says what is missing
  return std::make_unique<ChainedSource<Row>>(std::move(sources), diagnostics);
}

}  // namespace

ChainedRecording::ChainedRecording(std::vector<std::unique_ptr<Recording>> parts) : parts_(std::move(parts)) {
  std::vector<std::pair<Time, std::unique_ptr<Recording>>> ordered;
  for (auto& part : parts_) {
    const Time first = part->has_events() ? first_stamp<Event>(*part) : first_stamp<ImuSample>(*part);
    ordered.emplace_back(first, std::move(part));
  }
  std::stable_sort(ordered.begin(), ordered.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  for (std::size_t i = 0; i < parts_.size(); ++i) parts_[i] = std::move(ordered[i].second);
}

std::string ChainedRecording::format() const {
  return fmt::format("{}, in {} files", parts_[0]->format(), parts_.size());
}

bool ChainedRecording::has_events() const {
  return std::any_of(parts_.begin(), parts_.end(), [](const auto& part) { return part->has_events(); });
}

bool ChainedRecording::has_imu() const {
  return std::any_of(parts_.begin(), parts_.end(), [](const auto& part) { return part->has_imu(); });
}

std::unique_ptr<RowSource<Event>> ChainedRecording::events(Diagnostics& diagnostics) {
  return chain<Event>(parts_, &Recording::has_events, diagnostics);
}

std::unique_ptr<RowSource<ImuSample>> ChainedRecording::imu(Diagnostics& diagnostics) {
  return chain<ImuSample>(parts_, &Recording::has_imu, diagnostics);
}

std::optional<Trajectory> ChainedRecording::groundtruth() {
  Trajectory all;
  for (const auto& part : parts_) {
    const auto truth = part->groundtruth();
    for (const StampedPose& pose : truth.value_or(Trajectory{}))
      if (all.empty() || pose.t > all.back().t) all.push_back(pose);
  }
  return all.empty() ? std::nullopt : std::optional(std::move(all));
}

std::vector<std::filesystem::path> ChainedRecording::files() const {
  std::vector<std::filesystem::path> files;
  for (const auto& part : parts_)
    for (auto& file : part->files()) files.push_back(std::move(file));
  return files;
}

std::vector<StreamInfo> ChainedRecording::streams() {
  std::vector<StreamInfo> found;
  for (const auto& part : parts_)
    for (StreamInfo& stream : part->streams()) found.push_back(std::move(stream));
  return found;
}

}  // namespace idol
