// Parts of the page's data that the report and the live view have in common.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"

namespace idol {

using Json = nlohmann::ordered_json;

/// Six significant digits.
double rounded(double value);
/// Tenths of a millisecond.
double rounded_seconds(double s);

/// Columns t [s since zero], p (three numbers a pose) and q (four: x y z w).
Json path_json(std::span<const StampedPose> path, Time zero);

/// Columns id, a, b (three numbers a line), first, last [s since zero], windows, colour (of line_palette()).
Json lines_json(std::span<const Line> lines, Time zero);

/// Size, focal lengths and centre of the undistorted image.
Json camera_json(const Camera& camera);

/// line_palette() as CSS colours.
Json palette_json();

/// RFC 4648, with padding.
std::string base64(std::string_view bytes);

/// Without '<', so that it is safe inside a script element; what is no UTF-8 is replaced.
std::string safe_text(const Json& json);

}  // namespace idol
