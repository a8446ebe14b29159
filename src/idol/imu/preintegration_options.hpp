// What the user may choose about the inertial representation.
#pragma once

#include <array>
#include <string_view>

#include "idol/base/options.hpp"

namespace idol {

/// How the signals between the samples are seen; docs/preintegration.md compares them.
enum class PreintegrationMethod {
  kGpm,        ///< Gaussian process with a squared-exponential kernel (the paper)
  kLpm,        ///< straight from sample to sample
  kContinuous  ///< local polynomial through the nearest eight samples
};

inline constexpr std::array<std::string_view, 3> kPreintegrationMethods = {"gpm", "lpm", "continuous"};
constexpr std::span<const std::string_view> option_names(PreintegrationMethod) {
  return kPreintegrationMethods;
}

struct PreintegrationOptions {
  PreintegrationMethod method = PreintegrationMethod::kContinuous;
  double length_scale_samples = 3;
  int margin_samples = 3;
  double max_gap_s = 0.1;
  double gap_gyro_sigma = 1.0;
  double gap_accel_sigma = 5.0;
  double gyro_range = 0;
  double accel_range = 0;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("method", self.method, Range{},
          "inertial signals between the samples: gpm (the paper), lpm, continuous");
    visit("length_scale_samples", self.length_scale_samples, Range{0.5, 20},
          "gpm: length scale in IMU sample periods (Le Gentil 2020)");
    visit("margin_samples", self.margin_samples, Range{2, 200},
          "IMU samples used beyond each end of a window; the look-ahead before a window can be solved");
    visit("max_gap_s", self.max_gap_s, Range{0.002, 1},
          "longest IMU gap that is not reported and inflated [s]");
    visit("gap_gyro_sigma", self.gap_gyro_sigma, Range{0, 100},
          "unknown angular rate inside such a gap [rad/s]");
    visit("gap_accel_sigma", self.gap_accel_sigma, Range{0, 1000},
          "unknown acceleration inside such a gap [m/s^2]");
    visit("gyro_range", self.gyro_range, Range{0, 1000},
          "rate at which the gyro saturates [rad/s]; 0: recognised by repeated extremes");
    visit("accel_range", self.accel_range, Range{0, 10000},
          "specific force at which the accelerometer saturates [m/s^2]; 0: recognised by repeated extremes");
  }
};

}  // namespace idol
