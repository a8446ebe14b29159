// The events of one window.
#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "idol/io/bytes.hpp"
#include "idol/report/figure_makers.hpp"

namespace idol {
namespace {

constexpr Rgb kPaleEvent{190, 190, 190};

/// Ink that stands out on white; a line keeps its own in all windows.
Rgb print_colour(LineId id) {
  constexpr std::array<Rgb, 6> kInks = {ink::kOrange, ink::kSky,        ink::kGreen,
                                        ink::kBlue,   ink::kVermillion, ink::kPurple};
  return kInks[line_colour_index(id) % kInks.size()];
}

using EventsByLine = std::map<LineId, std::vector<Vec2>>;

/// The other side of pack_events(): events by line [px of the sensor]. Throws BadBytes.
EventsByLine unpack_events(const ShownWindow& window) {
  constexpr double kUnitsPerPixel = 8;
  constexpr std::uint32_t kNone = 0xffffffff;
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(window.packed.data());
  ByteCursor groups({bytes, window.packed.size()});
  std::vector<LineId> ids;  // one an event
  for (int left = groups.get<std::uint16_t>(); left > 0; --left) {
    const auto id = groups.get<std::uint32_t>();
    ids.insert(ids.end(), groups.get<std::uint16_t>() & 0x0fff, id == kNone ? kNoLine : LineId{id});
  }
  ByteCursor x = groups, y = groups;
  y.take(2 * ids.size());
  EventsByLine events;
  const auto pixel = [](int eighths) { return eighths / kUnitsPerPixel - 0.5; };
  for (const LineId id : ids) {
    const double px = pixel(x.get<std::uint16_t>() & 0x7fff);
    events[id].emplace_back(px, pixel(y.get<std::uint16_t>()));
  }
  return events;
}

/// The one with the most lines tells most; nothing if all are damaged.
std::pair<const ShownWindow*, EventsByLine> best_window(const std::vector<ShownWindow>& windows) {
  std::pair<const ShownWindow*, EventsByLine> best{nullptr, {}};
  for (const ShownWindow& window : windows) {
    try {
      EventsByLine events = unpack_events(window);
      if (best.first == nullptr || events.size() > best.second.size()) best = {&window, std::move(events)};
    } catch (const BadBytes&) {
      continue;
    }
  }
  return best;
}

/// The part of a segment in front of the camera, projected; nothing if there is none.
std::vector<Vec2> seen(const Camera& camera, Vec3 a, Vec3 b) {
  constexpr double kNear = 0.05;  // [m]
  if (a.z() < b.z()) std::swap(a, b);
  if (a.z() <= kNear) return {};
  if (b.z() < kNear) b = a + (a.z() - kNear) / (a.z() - b.z()) * (b - a);
  return {camera.project(a), camera.project(b)};
}

/// The pose at t, if the trajectory reaches it.
std::optional<Pose> pose_at(const Trajectory& path, Time t) {
  const auto after =
      std::lower_bound(path.begin(), path.end(), t, [](const StampedPose& p, Time at) { return p.t < at; });
  if (after == path.end() || (after == path.begin() && after->t > t)) return std::nullopt;
  if (after->t == t) return after->T;
  const auto before = after - 1;
  return interpolate(before->T, after->T,
                     seconds_between(before->t, t) / seconds_between(before->t, after->t));
}

PlotCurve dots_of(const std::vector<Vec2>& points, const Ink& ink) {
  PlotCurve dots{"", {}, {}, {ink}, 0.6};
  for (const Vec2& p : points) {
    dots.x.push_back(p.x());
    dots.y.push_back(p.y());
  }
  return dots;
}

}  // namespace

Figure event_figure(const FigureSource& source, double width) {
  const RunFolder& run = source.run;
  if (run.events.empty() || !run.camera_model) return {.plots = {}, .needs = "events_shown.bin and rig.yaml"};
  const auto [window, events] = best_window(run.events);
  if (window == nullptr) return {.plots = {}, .needs = "an undamaged events_shown.bin"};
  Plot plot{.x_label = "x [px]", .y_label = "y [px]"};
  plot.x_range = {-0.5, run.camera_model->width - 0.5};
  plot.y_range = {-0.5, run.camera_model->height - 0.5};
  plot.equal = plot.y_down = plot.plain = true;
  // kNoLine comes first: below the others.
  for (const auto& [id, points] : events)
    plot.curves.push_back(dots_of(points, {id == kNoLine ? kPaleEvent : print_colour(id)}));
  if (const auto T_w_c = pose_at(run.camera, window->t)) {
    const Pose T_c_w = T_w_c->inverse();
    for (const Line& line : run.lines) {
      if (window->t < line.first || window->t > line.last) continue;
      PlotCurve curve = dots_of(seen(*run.camera_model, T_c_w * line.a, T_c_w * line.b), {});
      curve.dot = 0;
      curve.pen = {{ink::kBlack}, 0.7};
      curve.name = "estimated lines";
      plot.curves.push_back(std::move(curve));
    }
  }
  const double height = equal_height(plot, width, 2 * width);
  return {{std::move(plot)}, height, {}};
}

}  // namespace idol
