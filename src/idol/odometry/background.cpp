#include "idol/odometry/background.hpp"

#include <utility>

#include "idol/base/diagnostics.hpp"

namespace idol {

Background::Background(std::size_t most_waiting) : most_waiting_(most_waiting), thread_([this] { work(); }) {}

Background::~Background() {
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Background::run(std::function<void()> job) {
  if (std::this_thread::get_id() == thread_.get_id())
    throw UsageError("a listener must not push to the estimation that it is part of");
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return jobs_.size() < most_waiting_ || failure_; });
  rethrow();
  if (failure_) throw UsageError("the estimation has ended with an error: make another Odometry");
  jobs_.push_back(std::move(job));
  lock.unlock();
  changed_.notify_all();
}

void Background::drain() {
  if (std::this_thread::get_id() == thread_.get_id())
    throw UsageError("a listener must not wait for the estimation that it is part of");
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return (jobs_.empty() && !busy_) || failure_; });
  rethrow();
}

// Once: not every exception can be thrown twice. With the mutex held.
void Background::rethrow() {
  if (failure_ && !std::exchange(heard_, true)) std::rethrow_exception(failure_);
}

void Background::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return over_ || !jobs_.empty(); });
    if (over_) return;
    const auto job = std::move(jobs_.front());
    jobs_.pop_front();
    busy_ = true;
    lock.unlock();
    std::exception_ptr failure;
    try {
      job();
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    busy_ = false;
    if (failure) {
      failure_ = failure;
      jobs_.clear();
    }
    changed_.notify_all();
  }
}

}  // namespace idol
