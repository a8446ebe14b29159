// Judges the segments of simulated recordings against their true lines; prints rows of
// docs/results_frontend.md:
//   study_frontend [KEY=VALUE | from=S | to=S | noise=HZ | seed=N | gyro=0]... SEQUENCE...
// KEY: an option of `idol config`; noise: events of noise added, per pixel and second, seed: other ones;
// gyro=0: the camera's turns are not given.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <exception>
#include <map>
#include <random>
#include <string>

#include "idol/base/median.hpp"
#include "idol/base/options.hpp"
#include "idol/base/rig.hpp"
#include "idol/image/tracker/delayed_labels.hpp"
#include "idol/odometry/presets.hpp"
#include "true_lines.hpp"

namespace idol::bench {
namespace {

constexpr double kNear = 1.5;    // [px], of one and the same line
constexpr double kFar = 4;       // [px] from all listed lines: curves, noise, and lines that are not listed
constexpr double kLong = 30;     // [px]
constexpr double kSlot = 0.001;  // [s]: one projection of the true lines for all its events
constexpr double kPart = 0.05;   // [s]: a segment is judged in parts of this length
constexpr Time kGrid = 1000;     // [ns] recorded times are multiples of it, those of added noise are not
constexpr double kViewStep = 0.01;  // [s]

struct Settings {
  Options options;
  double from_s = 1.5, to_s = 1e30, noise_hz = 0;
  unsigned seed = 1;
  bool gyro = true;
};

double median_or_0(const std::vector<double>& values) { return values.empty() ? 0 : median(values); }

// Events of a segment near each true line.
struct Votes {
  std::map<int, int> lines;
  int events = 0, near_any = 0;  // near_any: some listed line within 3 px
  Time first = 0, last = 0;

  [[nodiscard]] std::pair<int, int> best() const {  // line, events
    std::pair<int, int> out{-1, 0};
    for (const auto& [line, n] : lines)
      if (n > out.second) out = {line, n};
    return out;
  }
};

// Share of the events that lie near their segment's best line.
struct Purity {
  double pure = 0, events = 0, near_any = 0;
  void add(const Votes& v) { pure += v.best().second, events += v.events, near_any += v.near_any; }
};

// True lines by cells of the undistorted image, for one slot of time.
class Lookup {
 public:
  static constexpr int kCell = 4, kReach = 5, kBorder = 120;

  Lookup(int width, int height)
      : cols_((width + 2 * kBorder) / kCell + 1),
        rows_((height + 2 * kBorder) / kCell + 1),
        cells_(static_cast<std::size_t>(cols_) * static_cast<std::size_t>(rows_)) {}

  void fill(std::vector<TrueImage> lines) {
    for (auto& cell : cells_) cell.clear();
    lines_ = std::move(lines);
    for (std::uint32_t k = 0; k < lines_.size(); ++k) mark(lines_[k].a, lines_[k].b, k);
  }

  /// Calls take(line, distance) for lines that may be near.
  template <class Take>
  void near(const Vec2& px, Take&& take) const {
    const int c = column(px), r = row(px);
    if (c < 0 || r < 0 || c >= cols_ || r >= rows_) return;
    for (const std::uint32_t k : cells_[static_cast<std::size_t>(r * cols_ + c)])
      take(lines_[k], distance_to_segment(px, lines_[k]));
  }

 private:
  [[nodiscard]] int column(const Vec2& px) const {
    return static_cast<int>(std::floor((px.x() + kBorder) / kCell));
  }
  [[nodiscard]] int row(const Vec2& px) const {
    return static_cast<int>(std::floor((px.y() + kBorder) / kCell));
  }
  // All cells that have a point within kReach of the segment, row by row, and some more.
  void mark(const Vec2& a, const Vec2& b, std::uint32_t k) {
    const Vec2 d = b - a, reach = Vec2::Constant(kReach), low = a.cwiseMin(b) - reach,
               high = a.cwiseMax(b) + reach;
    for (int r = std::max(0, row(low)); r <= std::min(rows_ - 1, row(high)); ++r) {
      double from = 0, to = 1;  // of the segment, in reach of this row
      if (std::abs(d.y()) > 1e-6) {
        const double top = (r * kCell - kBorder - kReach - a.y()) / d.y();
        const double bottom = ((r + 1) * kCell - kBorder + kReach - a.y()) / d.y();
        from = std::clamp(std::min(top, bottom), 0.0, 1.0);
        to = std::clamp(std::max(top, bottom), 0.0, 1.0);
      }
      const Vec2 p = a + from * d, q = a + to * d;
      const int first = std::max(0, column(p.cwiseMin(q) - reach));
      const int last = std::min(cols_ - 1, column(p.cwiseMax(q) + reach));
      for (int c = first; c <= last; ++c) cells_[static_cast<std::size_t>(r * cols_ + c)].push_back(k);
    }
  }

  int cols_, rows_;
  std::vector<std::vector<std::uint32_t>> cells_;
  std::vector<TrueImage> lines_;
};

class Judge {
 public:
  Judge(const std::filesystem::path& sequence, const Camera& camera)
      : truth_(sequence, camera), undistort_(camera), lookup_(camera.width, camera.height) {}

  void add(const EventWindow& window, const SegmentedWindow& segments) {
    for (std::size_t i = window.overlap; i < window.events.size(); ++i) {
      const Event& e = window.events[i];
      const Time slot = e.t / from_seconds(kSlot);
      if (slot != slot_) {
        slot_ = slot;
        lookup_.fill(truth_.seen((2 * slot + 1) * from_seconds(kSlot) / 2));
      }
      judge_event(e, segments.ids[i]);
    }
    judge_fits(window, segments);
    for (; next_view_ <= window.end; next_view_ += from_seconds(kViewStep)) look();
  }

  [[nodiscard]] std::string row() {
    Purity part, life, listed;
    for (const auto& [key, votes] : parts_) {
      part.add(votes);
      if (2 * votes.near_any > votes.events) listed.add(votes);
    }
    for (const auto& [id, votes] : tracks_) life.add(votes);
    const auto [lives, longest] = track_lives();
    return fmt::format(
        "{:.3f} ({:.3f}, {:.3f}) | {:.3f} | {:.3f} | {:.3f} | {:.2f} px, {:.2f} deg | {:.2f} | {:.2f} | {} |",
        part.pure / part.events, part.pure / part.near_any, listed.pure / listed.near_any,
        life.pure / life.events, static_cast<double>(found_) / wanted_,
        static_cast<double>(taken_) / std::max<std::int64_t>(1, unlisted_), median_or_0(offsets_),
        median_or_0(angles_), median_or_0(lives), median_or_0(longest), tracks_.size());
  }

  void start(Time t) { next_view_ = t; }

  /// Takes the trail at which most of some events lie on a line.
  void find_trail(std::span<const Event> events) {
    constexpr std::array<double, 9> kTrails{0, 3e-4, 7e-4, 1.2e-3, 2e-3, 3e-3, 4.5e-3, 6.5e-3, 9e-3};  // [s]
    constexpr std::size_t kSlots = 60, kInSlot = 200;
    std::int64_t most = -1;
    double best = 0;
    for (const double trail : kTrails) {
      truth_.set_trail(trail);
      std::int64_t on = 0;
      for (std::size_t k = 0; k < kSlots; ++k) {
        const std::size_t from = k * events.size() / kSlots, to = std::min(events.size(), from + kInSlot);
        if (from == to) continue;
        lookup_.fill(truth_.seen(events[(from + to) / 2].t));
        for (const Event& e : events.subspan(from, to - from)) {
          double nearest = 1e9;
          lookup_.near(undistort_(e.x, e.y).cast<double>(),
                       [&](const TrueImage&, double distance) { nearest = std::min(nearest, distance); });
          on += nearest < 1 ? 1 : 0;
        }
      }
      if (on > most) most = on, best = trail;
    }
    truth_.set_trail(best);
    slot_ = -1;
  }

 private:
  void judge_event(const Event& e, LineId id) {
    const Vec2 px = undistort_(e.x, e.y).cast<double>();
    double nearest = 1e9, second = 1e9, length = 0;
    std::array<int, 32> near{};
    std::size_t count = 0;
    lookup_.near(px, [&](const TrueImage& line, double distance) {
      if (distance < kNear && count < near.size() &&
          std::find(near.begin(), near.begin() + count, line.line) == near.begin() + count)
        near[count++] = line.line;
      if (distance < nearest) {
        second = nearest;
        nearest = distance;
        length = line.length;
      } else {
        second = std::min(second, distance);
      }
    });
    if (nearest < 1 && length > 20 && second > 4 && e.t % kGrid == 0) {
      ++wanted_;
      found_ += id != kNoLine ? 1 : 0;
    }
    if (nearest > kFar && e.t % kGrid == 0) {
      ++unlisted_;
      taken_ += id != kNoLine ? 1 : 0;
    }
    if (id == kNoLine) return;
    for (Votes* votes : {&parts_[{id, e.t / from_seconds(kPart)}], &tracks_[id]}) {
      if (votes->events++ == 0) votes->first = e.t;
      votes->last = e.t;
      votes->near_any += nearest < 3 ? 1 : 0;
      for (std::size_t k = 0; k < count; ++k) ++votes->lines[near[k]];
    }
  }

  // Fitted lines at their middle time against the true line of most of their events.
  void judge_fits(const EventWindow& window, const SegmentedWindow& segments) {
    for (const Segment& s : segments.segments) {
      if (!s.straight) continue;
      const Time t = window.begin + from_seconds(s.line.time);
      const Vec2 a = s.line.point(s.line.u_min, s.line.time), b = s.line.point(s.line.u_max, s.line.time);
      const auto it = tracks_.find(s.id);
      if (it == tracks_.end()) continue;
      const auto line = truth_.seen(it->second.best().first, t);
      if (!line) continue;
      const Vec2 along = (line->b - line->a).normalized(), across(-along.y(), along.x());
      const double ea = across.dot(a - line->a), eb = across.dot(b - line->a);
      offsets_.push_back(std::sqrt((ea * ea + eb * eb) / 2));
      if (s.line.length_px() > kLong)
        angles_.push_back(180 / M_PI * std::atan(std::abs(ea - eb) / s.line.length_px()));
    }
  }

  // Which lines are in view, longer than kLong, now.
  void look() {
    for (const TrueImage& line : truth_.seen(next_view_)) {
      if (line.length < kLong) continue;
      auto& spans = in_view_[line.line];
      if (spans.empty() || next_view_ - spans.back().second > from_seconds(1.5 * kViewStep))
        spans.emplace_back(next_view_, next_view_);
      spans.back().second = next_view_;
    }
  }

  // Life of each track over the time that its line stays in view, and the best of each line.
  [[nodiscard]] std::pair<std::vector<double>, std::vector<double>> track_lives() const {
    std::vector<double> lives, longest;
    std::map<std::pair<int, Time>, double> best;
    for (const auto& [id, votes] : tracks_) {
      const int line = votes.best().first;
      const auto spans = in_view_.find(line);
      if (spans == in_view_.end()) continue;
      const Time middle = (votes.first + votes.last) / 2;
      for (const auto& [from, to] : spans->second) {
        if (middle < from || middle > to || seconds_between(from, to) < 0.3) continue;
        const double share =
            std::min(1.0, seconds_between(votes.first, votes.last) / seconds_between(from, to));
        lives.push_back(share);
        double& most = best[{line, from}];
        most = std::max(most, share);
      }
    }
    for (const auto& [key, share] : best) longest.push_back(share);
    return {lives, longest};
  }

  TrueLines truth_;
  UndistortMap undistort_;
  Lookup lookup_;
  Time slot_ = -1, next_view_ = 0;
  std::map<std::pair<LineId, Time>, Votes> parts_;
  std::map<LineId, Votes> tracks_;
  std::map<int, std::vector<std::pair<Time, Time>>> in_view_;
  std::int64_t wanted_ = 0, found_ = 0, unlisted_ = 0, taken_ = 0;
  std::vector<double> offsets_, angles_;
};

std::vector<Event> read_events(const std::filesystem::path& sequence, const Camera& camera,
                               const Settings& settings) {
  ReaderOptions reading;
  reading.need_imu = false;
  reading.to_s = settings.to_s;
  std::vector<Event> events;
  const auto reader = open_reader(sequence, reading);
  while (const auto packet = reader->next())
    events.insert(events.end(), packet->events.begin(), packet->events.end());
  if (events.empty() || settings.noise_hz <= 0) return events;
  std::mt19937 rng(settings.seed);
  const Time begin = events.front().t, end = events.back().t;
  const auto count = static_cast<std::size_t>(settings.noise_hz * camera.width * camera.height *
                                              seconds_between(begin, end));
  std::uniform_int_distribution<Time> time(begin, end);
  for (std::size_t i = 0; i < count; ++i)
    events.push_back({time(rng) / kGrid * kGrid + 1,
                      static_cast<std::uint16_t>(rng() % static_cast<unsigned>(camera.width)),
                      static_cast<std::uint16_t>(rng() % static_cast<unsigned>(camera.height)),
                      rng() % 2 == 0});
  std::stable_sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
  return events;
}

// What the gyro says of the camera's turns.
std::vector<CameraRate> read_rates(const std::filesystem::path& sequence) {
  const Rig rig = load_rig(sequence);
  ReaderOptions reading;
  reading.need_events = false;
  std::vector<CameraRate> all;
  const auto reader = open_reader(sequence, reading);
  while (const auto packet = reader->next()) {
    const auto rates = camera_rates(packet->imu, rig);
    all.insert(all.end(), rates.begin(), rates.end());
  }
  return all;
}

// The front-end sees the recording from its begin on; judged is from `from_s` on.
void study(const std::filesystem::path& sequence, const Settings& settings) {
  const auto camera = find_camera(sequence, {}, nullptr);
  if (!camera) throw DataError(sequence.string() + ": no calibration");
  const auto events = read_events(sequence, *camera, settings);
  if (events.empty()) throw DataError(sequence.string() + ": no events");
  const UndistortMap undistort(*camera);
  const auto segmenter = make_segmenter(settings.options.segment, undistort);
  Windower windower(settings.options.window);
  Judge judge(sequence, *camera);
  const Time from = events.front().t + from_seconds(settings.from_s);
  judge.start(from);
  judge.find_trail(std::span(events).subspan(static_cast<std::size_t>(
      std::lower_bound(events.begin(), events.end(), from, [](const Event& e, Time t) { return e.t < t; }) -
      events.begin())));
  double seconds = 0;
  std::size_t judged = 0;
  const std::vector<CameraRate> rates = settings.gyro ? read_rates(sequence) : std::vector<CameraRate>();
  DelayedLabels labels;
  const auto process = [&](const EventWindow& window) {
    const auto before = std::chrono::steady_clock::now();
    const SegmentedWindow segments = segmenter->process(window, rates_over(rates, window));
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - before;
    if (window.begin < from) return;
    seconds += spent.count();
    judged += window.events.size() - window.overlap;
    labels.add(window, segments);
    while (const auto ready = labels.pop()) judge.add(ready->window, ready->segments);
  };
  for (const Event& e : events) {
    windower.push({&e, 1});
    while (const auto window = windower.pop()) process(*window);
  }
  while (const auto ready = labels.flush()) judge.add(ready->window, ready->segments);
  fmt::print("| {} | {} {:.2f} |\n", sequence.filename().string(), judge.row(),
             1e-6 * static_cast<double>(judged) / seconds);
  std::fflush(stdout);
}

int run(int argc, char** argv) {
  Settings settings;
  settings.options = preset("realtime");
  std::vector<OptionField> fields;
  list_fields(settings.options, fields);
  fmt::print(
      "| recording | purity (of those within 3 px of a listed line, in segments mostly there) | purity over "
      "life | recall | of far "
      "events | fit at the "
      "middle | life of tracks / in view | longest track / in view | tracks | Mev/s |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n");
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto equals = argument.find('=');
    if (equals == std::string::npos) {
      study(std::filesystem::path(argument).lexically_normal(), settings);
      continue;
    }
    const std::string key = argument.substr(0, equals), value = argument.substr(equals + 1);
    if (key == "from")
      settings.from_s = std::stod(value);
    else if (key == "to")
      settings.to_s = std::stod(value);
    else if (key == "gyro")
      settings.gyro = value != "0";
    else if (key == "noise")
      settings.noise_hz = std::stod(value);
    else if (key == "seed")
      settings.seed = static_cast<unsigned>(std::stoul(value));
    else
      set_option(fields, key, value, "study_frontend");
  }
  return 0;
}

}  // namespace
}  // namespace idol::bench

int main(int argc, char** argv) {
  try {
    return idol::bench::run(argc, argv);
  } catch (const std::exception& e) {
    fmt::print(stderr, "study_frontend: {}\n", e.what());
    return 1;
  }
}
