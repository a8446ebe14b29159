// ROS 1 bags: events, IMU and poses by the types of their messages.
#pragma once

#include <memory>
#include <string>

#include "idol/io/bag_file.hpp"
#include "idol/io/recording.hpp"

namespace idol {

/// Events: dvs_msgs/EventArray, prophesee_event_msgs/EventArray, event_camera_msgs/EventPacket (mono, evt3).
/// IMU: sensor_msgs/Imu. Truth: geometry_msgs/PoseStamped, TransformStamped, nav_msgs/Odometry; taken as the
/// pose of the camera. Frames: sensor_msgs/Image. Choices are topics.
class BagRecording : public Recording {
 public:
  /// Throws DataError if the file is no bag.
  BagRecording(const std::filesystem::path& path, StreamChoice choice);

  [[nodiscard]] std::string format() const override { return "ROS 1 bag"; }
  [[nodiscard]] bool has_events() const override;
  [[nodiscard]] bool has_imu() const override;
  std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) override;
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) override;
  std::optional<Trajectory> groundtruth() override;
  [[nodiscard]] std::int64_t lost_poses() const override { return lost_poses_; }
  std::unique_ptr<FrameSource> frames() override;
  [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {bag_->file().name()}; }
  std::vector<StreamInfo> streams() override;
  Resolution resolution() override;

 private:
  /// The topic of the wanted kind; nullptr if there is none and none was asked for.
  const BagTopic* choose(bool (*wanted)(std::string_view), const std::string& name, const char* kind,
                         const char* option) const;
  void warn_of_damage(Diagnostics& diagnostics) const;

  std::shared_ptr<const BagFile> bag_;
  StreamChoice choice_;
  std::int64_t lost_poses_ = 0;
};

}  // namespace idol
