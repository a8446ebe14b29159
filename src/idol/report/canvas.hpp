// Vector drawing for print: pages of PDF, SVG or PNG, with text that stays text. The only place that knows
// cairo.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "idol/report/picture.hpp"

namespace idol {

enum class FigureFormat { kPdf, kSvg, kPng };

/// A colour and how much of it covers what is below, in [0, 1].
struct Ink {
  Rgb colour;
  double alpha = 1;
};

/// A line to draw: width and lengths of dash and gap [pt]; a dash of 0 is a solid line.
struct Pen {
  Ink ink;
  double width = 0.8;
  double dash = 0;
  double gap = 0;
};

/// Where a text's given point lies on it: 0 left or top, 0.5 middle, 1 right or bottom.
struct Anchor {
  double x = 0;
  double y = 0.5;
};

/// A rectangle on a page [pt].
struct Box {
  double left = 0, top = 0, width = 0, height = 0;

  [[nodiscard]] double right() const { return left + width; }
  [[nodiscard]] double bottom() const { return top + height; }
};

/// Points of 1/72 inch, x to the right, y down, origin at the page's upper left corner. Pages of equal
/// content are equal to the last byte: no time of day goes into the file.
class Canvas {
 public:
  /// The title is the PDF's. Throws DataError if the library below fails.
  Canvas(FigureFormat format, double dpi, const std::string& title);
  ~Canvas();
  Canvas(const Canvas&) = delete;
  Canvas& operator=(const Canvas&) = delete;

  /// Begins a page, with `name` in a PDF's table of contents. Only PDF has more than one. Throws DataError
  /// for a PNG too large to be made.
  void begin_page(double width, double height, const std::string& name);
  /// All bytes of the file; nothing may be drawn afterwards.
  std::string finish();

  /// Parts where a point is not finite are gaps.
  void line(std::span<const Vec2> points, const Pen& pen);
  void line(const Vec2& a, const Vec2& b, const Pen& pen) { line(std::array{a, b}, pen); }
  void polygon(std::span<const Vec2> points, const Ink& ink);
  void rectangle(const Box& box, const Pen& pen);
  void disc(const Vec2& centre, double radius, const Ink& ink);
  /// `quarter_turn`: reads upwards, the anchor still as seen along the text.
  void text(const Vec2& at, std::string_view text, double size, Anchor anchor = {}, bool quarter_turn = false,
            bool bold = false);
  [[nodiscard]] double text_width(std::string_view text, double size) const;
  /// Until `unclip`, what lies outside the box is not drawn.
  void clip(const Box& box);
  void unclip();

 private:
  struct Cairo;
  std::unique_ptr<Cairo> cairo_;
};

}  // namespace idol
