#include "idol/report/page_json.hpp"

#include <fmt/format.h>

#include <cmath>

#include "idol/report/picture.hpp"

namespace idol {

double rounded(double value) {
  if (!std::isfinite(value) || value == 0) return value;
  const int digits = 5 - static_cast<int>(std::floor(std::log10(std::abs(value))));
  const double scale = std::pow(10.0, std::abs(digits));
  return digits >= 0 ? std::round(value * scale) / scale : std::round(value / scale) * scale;
}

double rounded_seconds(double s) { return std::round(s * 1e4) / 1e4; }

Json path_json(std::span<const StampedPose> path, Time zero) {
  Json t = Json::array(), p = Json::array(), q = Json::array();
  for (const StampedPose& pose : path) {
    t.push_back(rounded_seconds(seconds_between(zero, pose.t)));
    for (double v : pose.T.p) p.push_back(rounded(v));
    for (double v : pose.T.q.coeffs()) q.push_back(rounded(v));
  }
  return {{"t", t}, {"p", p}, {"q", q}};
}

Json lines_json(std::span<const Line> lines, Time zero) {
  Json out;
  for (const char* column : {"id", "a", "b", "first", "last", "windows", "colour"})
    out[column] = Json::array();
  for (const Line& line : lines) {
    out["id"].push_back(line.id);
    for (double v : line.a) out["a"].push_back(rounded(v));
    for (double v : line.b) out["b"].push_back(rounded(v));
    out["first"].push_back(rounded_seconds(seconds_between(zero, line.first)));
    out["last"].push_back(rounded_seconds(seconds_between(zero, line.last)));
    out["windows"].push_back(line.windows);
    out["colour"].push_back(line_colour_index(line.id));
  }
  return out;
}

Json camera_json(const Camera& camera) {
  return {{"width", camera.width},    {"height", camera.height},  {"fx", rounded(camera.fx)},
          {"fy", rounded(camera.fy)}, {"cx", rounded(camera.cx)}, {"cy", rounded(camera.cy)}};
}

Json palette_json() {
  Json out = Json::array();
  for (const Rgb& c : line_palette()) out.push_back(fmt::format("#{:02x}{:02x}{:02x}", c.r, c.g, c.b));
  return out;
}

std::string base64(std::string_view bytes) {
  constexpr const char* kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned word = 0;
    for (std::size_t k = 0; k < 3; ++k)
      word = word << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k > bytes.size() ? '=' : kDigits[word >> (18 - 6 * k) & 63];
  }
  return text;
}

std::string safe_text(const Json& json) {
  // Neither "</script" nor "<!--" may appear, whatever the files hold: '<' is written as an escape.
  std::string safe;
  for (char c : json.dump(-1, ' ', false, Json::error_handler_t::replace))
    c == '<' ? safe += "\\u003c" : safe += c;
  return safe;
}

}  // namespace idol
