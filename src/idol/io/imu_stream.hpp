// The IMU samples of a recording: clean, in time order, and those of a burst at times of their own.
#pragma once

#include <cstddef>
#include <exception>
#include <memory>
#include <string>

#include "idol/imu/imu_bursts.hpp"
#include "idol/io/row_stream.hpp"

namespace idol {

/// Used as RowStream is; stamps increase strictly.
class ImuStream {
 public:
  /// `diagnostics` must outlive the stream.
  ImuStream(std::unique_ptr<RowSource<ImuSample>> source, InputCheck<ImuSample> check,
            Diagnostics& diagnostics, std::size_t skip = 0)
      : rows_(std::move(source), check, diagnostics, skip), diagnostics_(diagnostics) {}

  /// The next sample; false at the end. Throws DataError on damage, after all samples before it were given
  /// out.
  bool next(ImuSample& out);

  [[nodiscard]] const StreamPlace& place() const { return rows_.place(); }
  /// For a stream that is not read to its end. Throws DataError.
  void check_share() const { rows_.check_share(); }

 private:
  void read();
  void count_repeats(const ImuSample& newest);

  RowStream<ImuSample> rows_;
  Diagnostics& diagnostics_;
  ImuBursts bursts_;
  ImuBursts::Output ready_;
  std::size_t next_ = 0;        // of ready_.samples
  std::string first_doubtful_;  // place of the first sample with the stamp of the one before it
  bool over_ = false;
  std::exception_ptr damage_;
};

}  // namespace idol
