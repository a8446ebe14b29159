// An Odometry as Python uses it: any thread, numpy arrays, a Python function as the listener.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "event_columns.hpp"
#include "idol/odometry/odometry.hpp"

namespace idol::python {

/// What a listener is given. State and figures are its own; lines and covariance are looked up in the
/// estimator, which is possible while the listener runs.
class PyEstimate {
 public:
  explicit PyEstimate(const Estimate& estimate);
  void expire() { backend_ = nullptr; }

  NavState state;
  Pose T_w_c;
  SolveStats stats;
  std::size_t events = 0;  ///< of the window, those repeated from the one before left out
  double segment_s = 0, integrate_s = 0, solve_s = 0;
  [[nodiscard]] const Backend& backend() const;

 private:
  const Backend* backend_;
};

/// Calls a Python function with each estimate, from whatever thread. An exception in it becomes one of C++,
/// which the thread that pushes meets.
class Listener {
 public:
  explicit Listener(py::function function) : function_(std::move(function)) {}
  void operator()(const Estimate& estimate);
  [[nodiscard]] bool runs_in_this_thread() const { return caller_ == std::this_thread::get_id(); }

 private:
  py::function function_;
  std::atomic<std::thread::id> caller_;
};

/// Every method is called with the GIL, and releases it while the library works. One call at a time: another
/// thread's waits. None from within the listener, which would wait for itself. What a listener throws comes out
/// of the next call that feeds or waits; nothing can be fed after it.
class Session {
 public:
  Session(const Rig& rig, const Options& options);
  ~Session() { close(); }

  void on_estimate(const py::object& function);
  void push_events(const EventColumns& events);
  void push_imu(const std::vector<ImuSample>& samples);
  void end_imu();
  void wait();
  void finish();
  std::optional<NavState> predict(Time t);
  std::vector<NavState> states();
  std::vector<Line> lines();
  Trajectory camera();
  Diagnostics diagnostics();
  /// Ends the second thread, dropping what waits for it; nothing works after it.
  void close();

 private:
  template <class Work>
  auto locked(Work&& work);
  template <class Work>
  auto watched(Work&& work);
  template <class Work>
  void feed(Work&& work);

  std::mutex mutex_;  // taken without the GIL only: whoever holds it may be waiting for the listener
  Camera camera_;
  std::optional<Time> last_event_;
  bool finished_ = false, failed_ = false;
  std::unique_ptr<Listener> listener_;
  std::unique_ptr<Odometry> odometry_;
};

}  // namespace idol::python
