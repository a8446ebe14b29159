#include "idol/view/live_view.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "idol/report/event_log.hpp"
#include "idol/report/page_json.hpp"
#include "idol/report/report.hpp"
#include "idol/version.hpp"

namespace idol {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kShortestPause = std::chrono::milliseconds(33);  // thirty updates a second
constexpr double kCurveSeconds = 10;                            // that the page shows
constexpr std::size_t kMostPoses = 4000;                        // in one message

std::string message(const char* event, const Json& data) {
  return fmt::format("event: {}\ndata: {}\n\n", event, safe_text(data));
}

Json pose_json(const Pose& T) {
  Json p = Json::array(), q = Json::array();
  for (double v : T.p) p.push_back(rounded(v));
  for (double v : T.q.coeffs()) q.push_back(rounded(v));
  return {{"p", p}, {"q", q}};
}

}  // namespace

LiveView::LiveView(std::string name, const Rig& rig, int port)
    : name_(std::move(name)), rig_(rig), server_(port) {
  server_.add("/", "text/html", [this] {
    return page_with(safe_text(Json{{"kind", "live"}, {"name", name_}}));
  });
  server_.add_stream("/stream", [this](const PageServer::Send& send) { feed(send); });
  server_.start();
}

LiveView::~LiveView() { finish(""); }

LiveView::Row LiveView::row_of(const Estimate& e, const Sight& sight) {
  Row row;
  row.t = e.window.end;
  const double seconds = seconds_between(e.window.begin, e.window.end);
  const auto events = static_cast<double>(e.counts.events - counts_.events);
  row.rate = seconds > 0 ? 1e-3 * events / seconds : 0;
  row.kept = events > 0 ? 100 * static_cast<double>(e.counts.in_segments - counts_.in_segments) / events : 0;
  counts_ = e.counts;
  row.segments = static_cast<double>(e.segments.segments.size());
  row.lines = static_cast<double>(sight.lines.size());
  row.rms = e.stats.rms_px;
  row.front_ms = 1e3 * e.segment_s;
  row.solve_ms = 1e3 * (e.integrate_s + e.solve_s);
  row.speed = e.state.v_w.norm();
  if (const auto covariance = e.smoother.covariance())
    row.sigma = 3 * std::sqrt(covariance->block<3, 3>(6, 6).trace());
  return row;
}

void LiveView::add(const Estimate& e, const Sight& sight) {
  const Row row = row_of(e, sight);
  auto frame = std::make_shared<Frame>();
  frame->sight = sight;
  frame->own = e.window.events.size() - e.window.overlap;
  {
    const std::lock_guard lock(mutex_);
    path_.push_back({e.state.t, e.state.T_w_i * e.smoother.projection().T_i_c});
    rows_.push_back(row);
    frame_ = std::move(frame);
  }
  changed_.notify_all();
}

void LiveView::finish(const std::string& words) {
  {
    const std::lock_guard lock(mutex_);
    if (!over_) last_words_ = words;
    over_ = true;
  }
  changed_.notify_all();
  server_.stop();
}

std::string LiveView::hello() const {
  return message("hello", {{"name", name_},
                           {"camera", camera_json(rig_.camera)},
                           {"palette", palette_json()},
                           {"version", kVersion}});
}

void LiveView::feed(const PageServer::Send& send) {
  if (!send(hello())) return;
  std::size_t seen = 0;
  while (true) {
    const auto begin = Clock::now();
    const std::string text = next(seen);
    if (text.empty()) break;
    if (!send(text)) return;
    std::this_thread::sleep_until(begin + kShortestPause);
  }
  const std::lock_guard lock(mutex_);
  send(message("end", last_words_));
}

std::string LiveView::next(std::size_t& seen) {
  std::vector<StampedPose> path;
  std::vector<Row> rows;
  std::shared_ptr<const Frame> frame;
  const bool first = seen == 0;
  Time zero = 0;
  {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::seconds(1), [&] { return over_ || path_.size() > seen; });
    if (path_.size() == seen) return over_ ? "" : ": nothing new\n\n";
    zero = path_.front().t;
    const std::size_t step = (path_.size() - seen + kMostPoses - 1) / kMostPoses;
    for (std::size_t i = seen; i < path_.size(); ++i)
      if ((path_.size() - 1 - i) % step == 0) path.push_back(path_[i]);
    for (std::size_t i = seen; i < rows_.size(); ++i)
      if (seconds_between(rows_[i].t, rows_.back().t) <= kCurveSeconds) rows.push_back(rows_[i]);
    frame = frame_;
    seen = path_.size();
  }
  // What takes time is done without the lock.
  Json columns;
  const auto add_column = [&](const char* name, const auto& value) {
    columns[name] = Json::array();
    for (const Row& row : rows) columns[name].push_back(rounded(value(row)));
  };
  add_column("t", [&](const Row& r) { return rounded_seconds(seconds_between(zero, r.t)); });
  for (const auto& [name, member] : {std::pair{"rate", &Row::rate},
                                     {"kept", &Row::kept},
                                     {"segments", &Row::segments},
                                     {"lines", &Row::lines},
                                     {"rms", &Row::rms},
                                     {"front", &Row::front_ms},
                                     {"solve", &Row::solve_ms},
                                     {"speed", &Row::speed},
                                     {"sigma", &Row::sigma}})
    add_column(name, [&, m = member](const Row& r) { return r.*m; });
  std::uint32_t shown = 0;
  const std::string packed =
      pack_events(frame->sight.events, rig_.camera.width, rig_.camera.height, kMostShownEvents, shown);
  return message("update", {{"reset", first},
                            {"path", path_json(path, zero)},
                            {"rows", columns},
                            {"lines", lines_json(frame->sight.lines, zero)},
                            {"pose", pose_json(frame->sight.T_w_c)},
                            {"events",
                             {{"t", rounded_seconds(seconds_between(zero, frame->sight.t))},
                              {"own", frame->own},
                              {"around", frame->sight.events.size()},
                              {"shown", shown},
                              {"packed", base64(packed)}}}});
}

}  // namespace idol
