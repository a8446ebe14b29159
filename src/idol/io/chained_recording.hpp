// A recording in several files, one behind the other: `rosbag record --split`.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "idol/io/recording.hpp"

namespace idol {

class ChainedRecording : public Recording {
 public:
  /// At least one part; they are put in the order of their first events (without events: IMU samples).
  explicit ChainedRecording(std::vector<std::unique_ptr<Recording>> parts);

  [[nodiscard]] std::string format() const override;
  [[nodiscard]] bool has_events() const override;
  [[nodiscard]] bool has_imu() const override;
  /// What a part repeats of the one before it is left out, and counted.
  std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) override;
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) override;
  std::optional<Trajectory> groundtruth() override;
  std::unique_ptr<FrameSource> frames() override { return parts_[0]->frames(); }
  [[nodiscard]] std::vector<std::filesystem::path> files() const override;
  std::vector<StreamInfo> streams() override;
  Resolution resolution() override { return parts_[0]->resolution(); }

 private:
  std::vector<std::unique_ptr<Recording>> parts_;
};

}  // namespace idol
