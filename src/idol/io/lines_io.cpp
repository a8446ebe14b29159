#include <fmt/format.h>

#include <array>
#include <cstdint>

#include "idol/io/table.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {
namespace {

constexpr const char* kLinesHeader = "id,ax,ay,az,bx,by,bz,first_s,last_s,windows,events";

/// A colour that neighbouring ids do not share (Okabe and Ito's palette, distinct to colour-blind eyes too).
std::array<int, 3> colour_of(LineId id) {
  constexpr std::array<std::array<int, 3>, 7> kPalette = {{{230, 159, 0},
                                                           {86, 180, 233},
                                                           {0, 158, 115},
                                                           {240, 228, 66},
                                                           {0, 114, 178},
                                                           {213, 94, 0},
                                                           {204, 121, 167}}};
  return kPalette[static_cast<std::uint64_t>(id) % kPalette.size()];
}

}  // namespace

void write_lines_csv(const std::filesystem::path& path, std::span<const Line> lines) {
  TextWriter file(path);
  file.write(fmt::format("{}\n", kLinesHeader));
  for (const Line& line : lines) {
    file.write(fmt::format("{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{},{},{},{}\n", line.id, line.a.x(),
                           line.a.y(), line.a.z(), line.b.x(), line.b.y(), line.b.z(),
                           format_stamp(line.first), format_stamp(line.last), line.windows, line.events));
  }
  file.close();
}

std::vector<Line> read_lines_csv(const std::filesystem::path& path) {
  std::vector<Line> lines;
  read_table(path, kLinesHeader, [&](const TableRow& row) {
    lines.push_back({row.integer(0), row.vec3(1), row.vec3(4), row.stamp(7), row.stamp(8),
                     static_cast<int>(row.integer(9)), row.integer(10)});
  });
  return lines;
}

void write_lines_ply(const std::filesystem::path& path, std::span<const Line> lines) {
  TextWriter file(path);
  file.write(fmt::format(
      "ply\nformat ascii 1.0\ncomment 3D line segments in metres, world frame, z up\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nelement edge {}\n"
      "property int vertex1\nproperty int vertex2\nproperty uchar red\nproperty uchar green\nproperty uchar "
      "blue\n"
      "end_header\n",
      2 * lines.size(), lines.size()));
  for (const Line& line : lines) {
    const auto [r, g, b] = colour_of(line.id);
    for (const Vec3& end : {line.a, line.b})
      file.write(fmt::format("{:.6f} {:.6f} {:.6f} {} {} {}\n", end.x(), end.y(), end.z(), r, g, b));
  }
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const auto [r, g, b] = colour_of(lines[i].id);
    file.write(fmt::format("{} {} {} {} {}\n", 2 * i, 2 * i + 1, r, g, b));
  }
  file.close();
}

}  // namespace idol
