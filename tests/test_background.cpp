#include "idol/odometry/background.hpp"

#include <gtest/gtest.h>

#include "idol/base/diagnostics.hpp"

#include <stdexcept>
#include <vector>

namespace idol {
namespace {

TEST(Background, DoesJobsInOrder) {
  std::vector<int> done;
  Background background(2);
  for (int i = 0; i < 100; ++i) background.run([&done, i] { done.push_back(i); });
  background.drain();
  ASSERT_EQ(done.size(), 100U);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(done[static_cast<std::size_t>(i)], i);
}

TEST(Background, NothingIsDoneBehindAFailure) {
  bool later = false;
  Background background(4);
  background.run([] { throw std::runtime_error("no"); });
  EXPECT_THROW(background.drain(), std::runtime_error);
  EXPECT_THROW(background.run([&] { later = true; }), UsageError);
  background.drain();  // what there was can be asked for
  EXPECT_FALSE(later);
}

TEST(Background, AJobThatWaitsForItselfIsToldSo) {
  Background background(4);
  background.run([&] { background.drain(); });
  EXPECT_THROW(background.drain(), UsageError);
}

TEST(Background, EndsWithJobsWaiting) {
  Background background(100);
  for (int i = 0; i < 50; ++i)
    background.run([] { std::this_thread::sleep_for(std::chrono::milliseconds(1)); });
}

}  // namespace
}  // namespace idol
