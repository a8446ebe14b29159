// One thread that does jobs in the order they came.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace idol {

class Background {
 public:
  explicit Background(std::size_t most_waiting);
  /// Finishes the job at hand; what still waits is dropped.
  ~Background();
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  /// Waits while too many jobs wait. Throws what an earlier job threw, each time: no job is done behind that
  /// one, which may have left things half done.
  void run(std::function<void()> job);
  /// Waits for all jobs. Throws what one threw, once; UsageError in a job, which would wait for itself.
  void drain();

 private:
  void work();
  void rethrow();

  std::size_t most_waiting_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> jobs_;
  bool busy_ = false, over_ = false;
  std::exception_ptr failure_;  // of the job that was the last
  bool heard_ = false;          // by who waited or posted
  std::thread thread_;          // last: it uses all of the above
};

}  // namespace idol
