#include "idol/report/canvas.hpp"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <cairo.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kPointsPerInch = 72;
constexpr const char* kFont = "DejaVu Sans";  // wherever fontconfig is, this family is

struct DestroySurface {
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
struct DestroyContext {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
};
using Surface = std::unique_ptr<cairo_surface_t, DestroySurface>;
using Context = std::unique_ptr<cairo_t, DestroyContext>;

cairo_status_t append(void* bytes, const unsigned char* data, unsigned size) {
  static_cast<std::string*>(bytes)->append(reinterpret_cast<const char*>(data), size);
  return CAIRO_STATUS_SUCCESS;
}

void check(cairo_status_t status, const char* what) {
  if (status != CAIRO_STATUS_SUCCESS)
    throw DataError(fmt::format("{}: {}", what, cairo_status_to_string(status)));
}

void set_ink(cairo_t* context, const Ink& ink) {
  cairo_set_source_rgba(context, ink.colour.r / 255.0, ink.colour.g / 255.0, ink.colour.b / 255.0, ink.alpha);
}

void set_font(cairo_t* context, double size, bool bold) {
  cairo_select_font_face(context, kFont, CAIRO_FONT_SLANT_NORMAL,
                         bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(context, size);
}

}  // namespace

struct Canvas::Cairo {
  FigureFormat format;
  double dpi;
  std::string title;
  std::string bytes;
  Surface surface;
  Context context;
  int pages = 0;

  Surface create(double width, double page_height) {
    switch (format) {
      case FigureFormat::kPdf:
        return Surface(cairo_pdf_surface_create_for_stream(append, &bytes, width, page_height));
      case FigureFormat::kSvg: {
        Surface svg(cairo_svg_surface_create_for_stream(append, &bytes, width, page_height));
        cairo_svg_surface_set_document_unit(svg.get(), CAIRO_SVG_UNIT_PT);
        return svg;
      }
      case FigureFormat::kPng:
        break;
    }
    const auto pixels = [&](double length) {
      return static_cast<int>(std::lround(std::min(length * dpi / kPointsPerInch, 1e6)));
    };
    return Surface(cairo_image_surface_create(CAIRO_FORMAT_RGB24, pixels(width), pixels(page_height)));
  }

  /// The same letters at the same places, whatever the machine's taste in hinting.
  void prepare() {
    cairo_font_options_t* options = cairo_font_options_create();
    cairo_font_options_set_hint_style(options, CAIRO_HINT_STYLE_NONE);
    cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
    cairo_font_options_set_antialias(options, CAIRO_ANTIALIAS_GRAY);
    cairo_set_font_options(context.get(), options);
    cairo_font_options_destroy(options);
    cairo_set_line_join(context.get(), CAIRO_LINE_JOIN_ROUND);
    if (format == FigureFormat::kPng) {
      cairo_scale(context.get(), dpi / kPointsPerInch, dpi / kPointsPerInch);
      cairo_set_source_rgb(context.get(), 1, 1, 1);
      cairo_paint(context.get());
    }
  }
};

Canvas::Canvas(FigureFormat format, double dpi, const std::string& title)
    : cairo_(new Cairo{format, dpi, title, {}, {}, {}}) {}

Canvas::~Canvas() = default;

void Canvas::begin_page(double width, double height, const std::string& name) {
  Cairo& c = *cairo_;
  const bool first = c.pages++ == 0;
  if (first) {
    c.surface = c.create(width, height);
    check(cairo_surface_status(c.surface.get()), "a page of this size cannot be made");
    c.context.reset(cairo_create(c.surface.get()));
  } else {
    cairo_show_page(c.context.get());
  }
  if (c.format == FigureFormat::kPdf) {
    cairo_surface_t* pdf = c.surface.get();
    cairo_pdf_surface_set_size(pdf, width, height);
    if (first) {
      cairo_pdf_surface_set_metadata(pdf, CAIRO_PDF_METADATA_TITLE, c.title.c_str());
      cairo_pdf_surface_set_metadata(pdf, CAIRO_PDF_METADATA_CREATE_DATE, nullptr);
    }
    cairo_pdf_surface_add_outline(pdf, CAIRO_PDF_OUTLINE_ROOT, name.c_str(),
                                  fmt::format("page={}", c.pages).c_str(),
                                  static_cast<cairo_pdf_outline_flags_t>(0));
  }
  if (first) c.prepare();
}

std::string Canvas::finish() {
  Cairo& c = *cairo_;
  if (!c.surface) throw DataError("a figure without a page cannot be written");
  check(cairo_status(c.context.get()), "drawing a figure");
  if (c.format == FigureFormat::kPng)
    check(cairo_surface_write_to_png_stream(c.surface.get(), append, &c.bytes), "writing a PNG");
  c.context.reset();
  cairo_surface_finish(c.surface.get());
  check(cairo_surface_status(c.surface.get()), "writing a figure");
  return std::move(c.bytes);
}

void Canvas::line(std::span<const Vec2> points, const Pen& pen) {
  cairo_t* context = cairo_->context.get();
  bool down = false;
  for (const Vec2& p : points) {
    if (!p.allFinite()) {
      down = false;
      continue;
    }
    down ? cairo_line_to(context, p.x(), p.y()) : cairo_move_to(context, p.x(), p.y());
    down = true;
  }
  const double dashes[] = {pen.dash, pen.gap};
  cairo_set_dash(context, dashes, pen.dash > 0 ? 2 : 0, 0);
  cairo_set_line_width(context, pen.width);
  set_ink(context, pen.ink);
  cairo_stroke(context);
}

void Canvas::polygon(std::span<const Vec2> points, const Ink& ink) {
  cairo_t* context = cairo_->context.get();
  for (const Vec2& p : points) cairo_line_to(context, p.x(), p.y());
  cairo_close_path(context);
  set_ink(context, ink);
  cairo_fill(context);
}

void Canvas::rectangle(const Box& box, const Pen& pen) {
  const Vec2 corners[] = {{box.left, box.top},      {box.right(), box.top}, {box.right(), box.bottom()},
                          {box.left, box.bottom()}, {box.left, box.top},    {box.right(), box.top}};
  line(corners, pen);
}

void Canvas::disc(const Vec2& centre, double radius, const Ink& ink) {
  cairo_t* context = cairo_->context.get();
  cairo_new_sub_path(context);
  cairo_arc(context, centre.x(), centre.y(), radius, 0, 2 * kPi);
  set_ink(context, ink);
  cairo_fill(context);
}

void Canvas::text(const Vec2& at, std::string_view text, double size, Anchor anchor, bool quarter_turn,
                  bool bold) {
  cairo_t* context = cairo_->context.get();
  const std::string owned(text);
  cairo_save(context);
  set_font(context, size, bold);
  set_ink(context, {});
  cairo_translate(context, at.x(), at.y());
  if (quarter_turn) cairo_rotate(context, -0.5 * kPi);
  cairo_text_extents_t extents;
  cairo_text_extents(context, owned.c_str(), &extents);
  // Heights of capitals, not of this text: labels side by side share a baseline.
  constexpr double kCapital = 0.73;
  cairo_move_to(context, -anchor.x * extents.x_advance, (1 - anchor.y) * kCapital * size);
  cairo_show_text(context, owned.c_str());
  cairo_restore(context);
  cairo_new_path(context);
}

double Canvas::text_width(std::string_view text, double size) const {
  cairo_t* context = cairo_->context.get();
  cairo_save(context);
  set_font(context, size, false);
  cairo_text_extents_t extents;
  cairo_text_extents(context, std::string(text).c_str(), &extents);
  cairo_restore(context);
  return extents.x_advance;
}

void Canvas::clip(const Box& box) {
  cairo_save(cairo_->context.get());
  cairo_rectangle(cairo_->context.get(), box.left, box.top, box.width, box.height);
  cairo_clip(cairo_->context.get());
}

void Canvas::unclip() { cairo_restore(cairo_->context.get()); }

}  // namespace idol
