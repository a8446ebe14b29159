// Small recordings written, damaged and read back, whatever their format.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/recording_writer.hpp"
#include "test_util.hpp"

namespace idol::test {

inline std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// 0.1 s of events and IMU of a 240 x 180 sensor; part `i` follows part `i - 1`.
inline Packet some_packet(int part = 0) {
  std::mt19937 rng(static_cast<unsigned>(part) + 1);
  Packet packet;
  const Time begin = 1'500'000'000'000'000'000 + part * Time{100'000'000};
  for (int i = 0; i < 5000; ++i)
    packet.events.push_back({begin + i * Time{20'000}, static_cast<std::uint16_t>(rng() % 240),
                             static_cast<std::uint16_t>(rng() % 180), rng() % 2 == 0});
  for (int i = 0; i < 100; ++i)
    packet.imu.push_back(
        {begin + i * Time{1'000'000}, random_vec3(rng) + Vec3(0, 0, 9.81), random_vec3(rng)});
  return packet;
}

inline Trajectory some_truth() {
  std::mt19937 rng(7);
  Trajectory truth;
  for (int i = 0; i < 20; ++i) {
    const Quat q = Quat(1, 0.1 * i, 0.2, 0.3).normalized();
    truth.push_back({1'500'000'000'000'000'000 + i * Time{5'000'000}, {q, random_vec3(rng)}});
  }
  return truth;
}

inline void write(const std::filesystem::path& path, const std::vector<Packet>& packets, bool compress,
                  const Trajectory& truth = {}) {
  const auto writer = create_recording(path, format_of_name(path), {240, 180, compress});
  for (const Packet& packet : packets) writer->add(packet);
  if (!truth.empty()) {
    EXPECT_TRUE(writer->add_groundtruth(truth));
  }
  writer->close();
}

/// All that a recording gives, and how it ended.
struct ReadBack {
  std::vector<Event> events;
  std::vector<ImuSample> imu;
  std::map<std::string, Diagnostics::Entry> warnings;
  std::string error;
};

inline ReadBack read_back(const std::filesystem::path& path, const StreamChoice& choice = {}) {
  ReadBack result;
  std::unique_ptr<Reader> reader;
  try {
    ReaderOptions options;
    options.need_events = options.need_imu = false;
    options.imu_if_present = true;
    options.choice = choice;
    reader = open_reader(path, options);
    while (const auto packet = reader->next()) {
      result.events.insert(result.events.end(), packet->events.begin(), packet->events.end());
      result.imu.insert(result.imu.end(), packet->imu.begin(), packet->imu.end());
    }
  } catch (const std::runtime_error& e) {
    result.error = e.what();
  }
  if (reader) result.warnings = reader->diagnostics().entries();
  return result;
}

inline void expect_same(const ReadBack& read, const Packet& written) {
  EXPECT_EQ(read.error, "");
  EXPECT_EQ(read.events, written.events);
  ASSERT_EQ(read.imu.size(), written.imu.size());
  for (std::size_t i = 0; i < read.imu.size(); ++i) {
    EXPECT_EQ(read.imu[i].t, written.imu[i].t);
    EXPECT_EQ(read.imu[i].accel, written.imu[i].accel);
    EXPECT_EQ(read.imu[i].gyro, written.imu[i].gyro);
  }
}

/// Bytes changed, removed and doubled anywhere: an error, a warning or other values, never a crash, and the
/// error names the file.
inline void expect_survives_damage(const TempDir& dir, const std::string& whole) {
  std::mt19937 rng(11);
  for (int trial = 0; trial < 150; ++trial) {
    std::string bad = whole;
    const std::size_t at = rng() % (trial % 3 == 0 ? std::min<std::size_t>(bad.size(), 6000) : bad.size());
    switch (trial % 4) {
      case 0:
        bad.resize(at);
        break;
      case 1:
        bad[at] = static_cast<char>(rng());
        break;
      case 2:
        for (std::size_t i = at; i < std::min(bad.size(), at + 8); ++i) bad[i] = static_cast<char>(0xff);
        break;
      default:
        bad.erase(at, 1 + rng() % 16);
    }
    const auto path = dir.write("damaged", bad);
    const ReadBack r = read_back(path);
    EXPECT_TRUE(r.error.empty() || r.error.find("damaged") != std::string::npos) << r.error;
    try {
      open_recording(path)->groundtruth();
    } catch (const std::runtime_error&) {
    }
  }
}

}  // namespace idol::test
