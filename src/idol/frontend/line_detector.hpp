// New lines from the events that no live line claims: support, local planes on the surface of last events,
// growth.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"
#include "idol/frontend/patch.hpp"

namespace idol {

/// A straight cluster found: where it was at that time and how it moves along its normal.
struct LineSeed {
  Time time = 0;
  Eigen::Vector2d centre, normal;  ///< [px], unit
  double speed = 0;                ///< along the normal [px/s]
  double length = 0;               ///< [px]
};

class LineDetector {
 public:
  explicit LineDetector(const UndistortMap& undistort);
  /// Before each batch: how many events of it may be looked at closely (when the batch before had more, only
  /// every second, third, ... one is), the time that counts as a pixel [s/px], and the shortest line [px].
  void begin_batch(Time begin, double most, double c, double min_length);
  /// Events that were left out for this, by now.
  [[nodiscard]] std::int64_t skipped() const { return skipped_; }
  /// Fetches the memory that an event will need.
  void prefetch(const Event& event) const {
    const auto& stamps = stamps_[event.polarity ? 1 : 0];
    const std::size_t pixel = static_cast<std::size_t>(event.y) * width_ + event.x;
    __builtin_prefetch(&stamps[pixel]);
    __builtin_prefetch(&edges_[event.polarity ? 1 : 0].cluster[pixel]);
  }
  /// Takes an unclaimed event.
  void add(const Event& event);
  /// What the batch's events completed, until the next batch.
  [[nodiscard]] std::span<const LineSeed> end_batch();

 private:
  // A piece of the image: passages there of late, and those that had to be looked at.
  struct Block {
    int tried = 0, passed = 0;
  };
  // By serial numbers, of which the newest are known. Apart from the rest, since they are asked for often.
  struct Name {
    std::uint32_t serial = 0, merged_into = 0;
  };
  // Moments of a cluster's points (x, y [px], t [s]) relative to its first.
  struct Cluster {
    std::uint32_t serial = 0;
    int n = 0, tested = 0;
    Time t0 = 0;
    Eigen::Vector2d origin = Eigen::Vector2d::Zero();
    Eigen::Vector3d s = Eigen::Vector3d::Zero();
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  };

  [[nodiscard]] Block& block_of(const Event& event);
  [[nodiscard]] bool promising(const Event& event);
  Cluster* find(std::uint32_t serial);
  Cluster& create(const Eigen::Vector2d& px, Time t);
  void merge(Cluster& into, Cluster& from);
  void grow_waiting();
  void grow(const Event& event, const Patch& patch, Eigen::Vector3f normal);
  bool test(Cluster& cluster, Time now);
  void encourage(const LineSeed& seed);

  const UndistortMap* undistort_;
  int width_, height_;
  std::vector<std::uint32_t> stamps_[2];  // of the latest first-of-passage event [us]; 0 = none yet
  std::array<LocalEdges, 2> edges_;
  int block_cols_, block_rows_;
  std::vector<Block> blocks_;
  Time next_fade_ = 0;
  std::vector<Name> names_;
  std::vector<Cluster> pool_;
  std::uint32_t next_serial_ = 1;
  std::int64_t candidates_ = 0, stride_ = 1;  // of this batch; of how many candidates one is looked at
  std::int64_t skipped_ = 0;
  double c_ = 0, min_length_ = 0;
  // Events with their patches, until there are enough for planes at once.
  std::array<Event, kPlanesAtOnce> events_;
  std::array<Patch, kPlanesAtOnce> patches_;
  std::size_t waiting_ = 0;
  std::vector<LineSeed> seeds_;
};

}  // namespace idol
