#include "idol/map/line_map.hpp"

#include <algorithm>
#include <cmath>

namespace idol {

std::size_t LineMap::Hash::operator()(const Cell& cell) const {
  std::size_t out = 0;
  for (const std::int64_t value : cell) out = out * 0x9E3779B97F4A7C15ULL + static_cast<std::size_t>(value);
  return out ^ (out >> 32);
}

LineMap::Cell LineMap::cell_of(const Vec3& position, int level) {
  const double edge = std::ldexp(1.0, level);
  const auto index = [&](double x) { return static_cast<std::int64_t>(std::floor(x / edge)); };
  return {level, index(position.x()), index(position.y()), index(position.z())};
}

LineMap::Cell LineMap::cell_of(const ArchivedLine& line) {
  const int level = static_cast<int>(std::ceil(std::log2(std::max(line.distance_m, 1e-3))));
  return cell_of(0.5 * (line.ends.a + line.ends.b), level);
}

void LineMap::insert(ArchivedLine line) {
  erase(line.id);
  const Cell cell = cell_of(line);
  cells_[cell].push_back(line.id);
  ++levels_[static_cast<int>(cell[0])];
  const LineId id = line.id;
  lines_.emplace(id, std::move(line));
}

void LineMap::erase(LineId id) {
  const auto it = lines_.find(id);
  if (it == lines_.end()) return;
  const Cell cell = cell_of(it->second);
  const auto in_cell = cells_.find(cell);
  std::erase(in_cell->second, id);
  if (in_cell->second.empty()) cells_.erase(in_cell);
  const auto level = levels_.find(static_cast<int>(cell[0]));
  if (--level->second == 0) levels_.erase(level);
  lines_.erase(it);
}

const ArchivedLine* LineMap::find(LineId id) const {
  const auto it = lines_.find(id);
  return it == lines_.end() ? nullptr : &it->second;
}

std::vector<const ArchivedLine*> LineMap::near(const Vec3& position) const {
  constexpr std::int64_t kReach = 2;  // cells
  std::vector<const ArchivedLine*> out;
  for (const auto& [level, count] : levels_) {
    const Cell middle = cell_of(position, level);
    for (std::int64_t dx = -kReach; dx <= kReach; ++dx)
      for (std::int64_t dy = -kReach; dy <= kReach; ++dy)
        for (std::int64_t dz = -kReach; dz <= kReach; ++dz)
          if (const auto it = cells_.find({level, middle[1] + dx, middle[2] + dy, middle[3] + dz});
              it != cells_.end())
            for (const LineId id : it->second) out.push_back(&lines_.at(id));
  }
  std::sort(out.begin(), out.end(), [](const auto* a, const auto* b) { return a->id < b->id; });
  return out;
}

}  // namespace idol
