#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/report/event_log.hpp"
#include "idol/report/run_folder.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::TempDir;

std::uint16_t word_at(const std::string& bytes, std::size_t offset) {
  std::uint16_t word = 0;
  std::memcpy(&word, bytes.data() + offset, sizeof word);
  return word;
}

TEST(EventLog, GroupsEventsByLine) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<PictureEvent> events = {{{100, 1}, 7, true},
                                            {{10, 20}, kNoLine, false},
                                            {{0, 2}, 7, false},
                                            {{-3, 2}, 7, true},
                                            {{kNan, 0}, 8, true}};
  std::uint32_t shown = 0;
  const std::string bytes = pack_events(events, 240, 180, 100, shown);
  EXPECT_EQ(shown, 3U) << "what lies outside the sensor is not shown";
  ASSERT_EQ(bytes.size(), 2U + 2 * 6 + 3 * 4);
  EXPECT_EQ(word_at(bytes, 0), 2) << "groups";
  EXPECT_EQ(word_at(bytes, 6), 15 << 12 | 1) << "one event of no line, first";
  EXPECT_EQ(word_at(bytes, 8), 7);
  EXPECT_EQ(word_at(bytes, 12), line_colour_index(7) << 12 | 2);
  EXPECT_EQ(word_at(bytes, 14), 84) << "x in eighths from the corner";
  EXPECT_EQ(word_at(bytes, 16), 0x8000 | 804) << "with the polarity";
  EXPECT_EQ(word_at(bytes, 24), 20) << "y";
}

TEST(EventLog, PicksEvenly) {
  std::vector<PictureEvent> events;
  for (int i = 0; i < 1000; ++i) events.push_back({{static_cast<float>(i % 200), 0}, i < 500 ? 1 : 2, true});
  std::uint32_t shown = 0;
  const std::string bytes = pack_events(events, 240, 180, 100, shown);
  EXPECT_EQ(shown, 100U);
  EXPECT_EQ(word_at(bytes, 6) & 0xfff, 50);
  EXPECT_EQ(pack_events({}, 240, 180, 100, shown).size(), 2U);
}

TEST(EventLog, StaysWithinItsBoundAndComesBack) {
  const TempDir dir;
  EventLog log(240, 180, 20000);
  const std::vector<PictureEvent> events(100, PictureEvent{{5, 5}, 3, true});
  for (int i = 0; i < 1000; ++i) log.add(Time{50'000'000} * i, 4000, events);
  const std::size_t kept = log.windows().size();
  EXPECT_GT(kept, 20U);
  EXPECT_LE(kept * log.windows()[0].packed.size(), 20000U);
  const Time pace = log.windows()[1].t - log.windows()[0].t;
  for (std::size_t i = 1; i < kept; ++i)
    EXPECT_EQ(log.windows()[i].t - log.windows()[i - 1].t, pace) << "evenly spread, whatever the length";
  log.write(dir.path() / "log");
  const auto back = read_event_log(dir.path() / "log");
  ASSERT_EQ(back.size(), kept);
  EXPECT_EQ(back.back().t, log.windows().back().t);
  EXPECT_EQ(back.back().own, 4000U);
  EXPECT_EQ(back.back().packed, log.windows().back().packed);
}

TEST(EventLog, DamageIsTold) {
  const TempDir dir;
  EventLog log(240, 180);
  log.add(1, 5, std::vector<PictureEvent>(5));
  log.write(dir.path() / "log");
  const std::string whole = read_file(dir.path() / "log");
  for (std::size_t size = 0; size < whole.size(); size += 3) {
    if (size == 8) continue;
    EXPECT_THROW(read_event_log(dir.write("cut", whole.substr(0, size))), DataError) << size;
  }
  std::string swollen = whole;
  std::memset(swollen.data() + 28, 0xff, 4);
  EXPECT_THROW(read_event_log(dir.write("swollen", swollen)), DataError);
  EXPECT_THROW(read_event_log(dir.path() / "none"), DataError);
}

}  // namespace
}  // namespace idol
