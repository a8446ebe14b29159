// Does the image move? By the lines in it: a camera at rest trembles about one place, a slow pan goes on.
#pragma once

#include <deque>
#include <map>

#include "idol/frontend/segments.hpp"

namespace idol {

class ImageMotion {
 public:
  ImageMotion(int width, int height) : width_(width), height_(height) {}
  /// The next window.
  void add(const EventWindow& window, const SegmentedWindow& segments);
  /// True if many of the lines in the newest window have moved on across themselves within the last half
  /// second, and, of the image's width and height, those that have fill `spread`.
  [[nodiscard]] bool moves(double spread = 0) const;

 private:
  struct Seen {
    Time t = 0;
    Eigen::Vector2d middle, normal;
  };
  double width_, height_;  // [px]
  Time newest_ = 0;
  std::map<LineId, std::deque<Seen>> lines_;
};

}  // namespace idol
