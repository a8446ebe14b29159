#include "idol/report/hints.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace idol {
namespace {

// Limits below or above which something is worth a sentence.
constexpr double kExcitedAcceleration = 0.25;  // RMS about its mean over kExcitementSpan [m/s^2]
constexpr double kExcitementSpan = 1.0;        // [s]
constexpr double kMoving = 0.05;               // [m/s]
constexpr double kTurning = 0.5;               // [rad/s]
constexpr double kFewLines = 4;
constexpr double kManyHot = 0.05, kManyThinned = 0.2;  // shares of the events
constexpr double kOutsideBand = 0.1;                   // share of errors beyond three sigma

class Hints {
 public:
  Hints(const RunFolder& run, Time zero) : run_(run), zero_(zero) {
    for (Time t : run.windows.t) t_.push_back(seconds_between(zero, t));
  }

  void excitation();
  void parallax();
  void windows();
  void consistency(const std::vector<Panel>& panels);
  std::vector<std::string> take() { return std::move(out_); }

 private:
  void add(const char* words, const Spans& spans) {
    if (!spans.empty()) out_.push_back(fmt::format("{} {}.", words, describe(spans)));
  }
  // Spans of windows whose value of a column fulfils a condition; none without the column.
  Spans where(const char* column, const std::function<bool(double, std::size_t)>& condition,
              double shortest_s) {
    const std::vector<double>* values = run_.windows.find(column);
    if (values == nullptr) return {};
    std::vector<bool> holds;
    for (std::size_t i = 0; i < values->size(); ++i)
      holds.push_back(std::isfinite((*values)[i]) && condition((*values)[i], i));
    return spans_where(t_, holds, 0.2, shortest_s);
  }
  double value(const char* column, std::size_t row) const {
    const std::vector<double>* values = run_.windows.find(column);
    return values == nullptr ? std::numeric_limits<double>::quiet_NaN() : (*values)[row];
  }

  // At rest nothing is seen, and nothing is missed.
  [[nodiscard]] bool moves_at(Time t) const {
    const auto state = std::lower_bound(run_.states.begin(), run_.states.end(), t,
                                        [](const NavState& s, Time time) { return s.t < time; });
    return state == run_.states.end() || state->v_w.norm() > kMoving;
  }

  const RunFolder& run_;
  Time zero_;
  std::vector<double> t_;
  std::vector<std::string> out_;
};

// The scale comes from accelerations: constant velocity leaves it to what was known before.
void Hints::excitation() {
  const std::vector<NavState>& states = run_.states;
  std::vector<double> t;
  std::vector<bool> weak;
  std::vector<Vec3> acceleration;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const double dt = seconds_between(states[i - 1].t, states[i].t);
    if (dt > 0) {
      t.push_back(seconds_between(zero_, states[i].t));
      acceleration.push_back((states[i].v_w - states[i - 1].v_w) / dt);
      weak.push_back(states[i].v_w.norm() > kMoving);
    }
  }
  std::size_t from = 0, to = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    while (t[i] - t[from] > kExcitementSpan / 2) ++from;
    while (to < t.size() && t[to] - t[i] <= kExcitementSpan / 2) ++to;
    Vec3 mean = Vec3::Zero();
    double squares = 0;
    for (std::size_t k = from; k < to; ++k) {
      mean += acceleration[k];
      squares += acceleration[k].squaredNorm();
    }
    const auto n = static_cast<double>(to - from);
    const double variance = squares / n - (mean / n).squaredNorm();
    weak[i] = weak[i] && mean.norm() / n < kExcitedAcceleration &&
              variance < kExcitedAcceleration * kExcitedAcceleration;
  }
  add("Accelerometer hardly excited: scale is weak", spans_where(t, weak, 0.2, 0.8));
}

// Turning in place gives lines no depth.
void Hints::parallax() {
  const std::vector<NavState>& states = run_.states;
  std::vector<double> t;
  std::vector<bool> holds;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const double dt = seconds_between(states[i - 1].t, states[i].t);
    if (dt <= 0) continue;
    t.push_back(seconds_between(zero_, states[i].t));
    const double rate = quat_log(states[i - 1].T_w_i.q.conjugate() * states[i].T_w_i.q).norm() / dt;
    holds.push_back(rate > kTurning && states[i].v_w.norm() < kMoving);
  }
  add("Turning in place: new lines get no depth", spans_where(t, holds, 0.2, 0.5));
}

void Hints::windows() {
  add("Velocity not yet known after a start in motion or anew: poses are rough",
      where(
          "settled", [](double settled, std::size_t) { return settled == 0; }, 0.1));
  add("Few lines in sight: the IMU is nearly alone",
      where(
          "lines_seen",
          [&](double seen, std::size_t i) { return seen < kFewLines && moves_at(run_.windows.t[i]); }, 0.3));
  add("The front-end left out many events to keep up",
      where(
          "thinned", [&](double n, std::size_t i) { return n > kManyThinned * value("events", i); }, 0.3));
  add("Slower than real time", where(
                                   "solve_s",
                                   [&](double s, std::size_t i) {
                                     return std::max(s + value("integrate_s", i), value("segment_s", i)) >
                                            value("duration_s", i);
                                   },
                                   0.3));
  if (const auto* restarts = run_.windows.find("restarts")) {
    for (std::size_t i = 1; i < restarts->size(); ++i)
      if ((*restarts)[i] > (*restarts)[i - 1])
        out_.push_back(
            fmt::format("The estimator was lost and began anew at {:.1f} s: what is before and after "
                        "hangs together loosely.",
                        t_[i]));
  }
  double hot = 0, events = 0;
  for (std::size_t i = 0; i < t_.size(); ++i) {
    hot += value("hot", i);
    events += value("events", i);
  }
  if (hot > kManyHot * events)
    out_.push_back(fmt::format("{:.0f} % of the events come from hot pixels.", 100 * hot / events));
}

// Does the truth lie within what the estimator says of itself?
void Hints::consistency(const std::vector<Panel>& panels) {
  for (const auto& [title, what] : {std::pair{"Causal position error by axis", "position"},
                                    std::pair{"Causal rotation error by axis of the IMU", "rotation"},
                                    std::pair{"Causal velocity error by axis", "velocity"}}) {
    std::size_t outside = 0, all = 0;
    for (const Panel& panel : panels) {
      if (panel.title != title) continue;
      for (const Series& s : panel.series)
        for (std::size_t i = 0; i < s.band.size(); ++i) {
          if (!std::isfinite(s.y[i]) || !(s.band[i] > 0)) continue;
          ++all;
          if (std::abs(s.y[i]) > s.band[i]) ++outside;
        }
    }
    if (static_cast<double>(outside) > kOutsideBand * static_cast<double>(all))
      out_.push_back(
          fmt::format("The estimator trusts its {} too much: {:.0f} % of the errors against ground "
                      "truth lie outside its 3-sigma band.",
                      what, 100 * static_cast<double>(outside) / static_cast<double>(all)));
  }
}

}  // namespace

std::vector<std::string> run_hints(const RunFolder& run, const std::vector<Panel>& panels, Time zero) {
  Hints hints(run, zero);
  hints.windows();
  hints.excitation();
  hints.parallax();
  hints.consistency(panels);
  return hints.take();
}

Spans spans_where(const std::vector<double>& t, const std::vector<bool>& holds, double hole_s,
                  double shortest_s) {
  Spans spans;
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (!holds[i]) continue;
    const double from = i > 0 ? t[i - 1] : t[i];  // a value stands for the time since the one before
    if (!spans.empty() && from - spans.back().second <= hole_s)
      spans.back().second = t[i];
    else
      spans.emplace_back(from, t[i]);
  }
  std::erase_if(spans, [&](const auto& span) { return span.second - span.first < shortest_s; });
  return spans;
}

std::string describe(const Spans& spans) {
  constexpr std::size_t kMost = 3;
  std::string text = "from ";
  for (std::size_t i = 0; i < std::min(spans.size(), kMost); ++i)
    text += fmt::format("{}{:.1f} to {:.1f} s", i > 0 ? ", " : "", spans[i].first, spans[i].second);
  if (spans.size() > kMost) text += fmt::format(" and {} more times", spans.size() - kMost);
  return text;
}

}  // namespace idol
