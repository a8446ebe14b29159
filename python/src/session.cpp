#include "session.hpp"

#include <stdexcept>
#include <utility>

#include "idol/base/diagnostics.hpp"

namespace idol::python {

PyEstimate::PyEstimate(const Estimate& e)
    : state(e.state),
      T_w_c(e.state.T_w_i * e.smoother.projection().T_i_c),
      stats(e.stats),
      events(e.window.events.size() - e.window.overlap),
      segment_s(e.segment_s),
      integrate_s(e.integrate_s),
      solve_s(e.solve_s),
      backend_(&e.smoother) {}

const Backend& PyEstimate::backend() const {
  if (backend_ == nullptr)
    throw std::runtime_error("lines and covariance of an estimate are there while on_estimate's function runs");
  return *backend_;
}

void Listener::operator()(const Estimate& estimate) {
  const py::gil_scoped_acquire gil;
  const auto told = std::make_shared<PyEstimate>(estimate);
  caller_ = std::this_thread::get_id();
  try {
    function_(told);
  } catch (...) {
    caller_ = std::thread::id();
    told->expire();
    throw;
  }
  caller_ = std::thread::id();
  told->expire();
}

Session::Session(const Rig& rig, const Options& options)
    : camera_(rig.camera), odometry_(std::make_unique<Odometry>(rig, options)) {}

void Session::close() {
  const py::gil_scoped_release unlocked;
  const std::lock_guard lock(mutex_);
  odometry_.reset();
}

template <class Work>
auto Session::locked(Work&& work) {
  if (listener_ && listener_->runs_in_this_thread())
    throw std::runtime_error("an Odometry cannot be used by its own on_estimate function");
  const py::gil_scoped_release unlocked;
  const std::lock_guard lock(mutex_);
  if (!odometry_) throw std::runtime_error("this Odometry is closed");
  return work(*odometry_);
}

// What fails half-way leaves a gap that nothing can be appended to.
template <class Work>
auto Session::watched(Work&& work) {
  return locked([&](Odometry& odometry) {
    try {
      return work(odometry);
    } catch (...) {
      failed_ = true;
      throw;
    }
  });
}

template <class Work>
void Session::feed(Work&& work) {
  locked([&](Odometry&) {
    if (finished_) throw std::runtime_error("this Odometry is finished: make another one");
    if (failed_) throw std::runtime_error("this Odometry has ended with an error: make another one");
  });
  watched(work);
}

void Session::on_estimate(const py::object& function) {
  auto listener = function.is_none() ? nullptr : std::make_unique<Listener>(function.cast<py::function>());
  watched([&](Odometry& odometry) {
    odometry.wait();
    odometry.on_estimate(listener ? std::function<void(const Estimate&)>(std::ref(*listener)) : nullptr);
  });
  listener_ = std::move(listener);
}

// Twice over the data: all of it is checked before the first event goes in. Checked again then, since another
// thread of Python may have written there meanwhile.
void Session::push_events(const EventColumns& events) {
  const auto for_each_piece = [&](std::optional<Time>& last, const auto& use) {
    EventColumns::Piece buffer;
    for (std::size_t i = 0; i < events.size(); i += EventColumns::kPiece)
      use(events.piece(i, camera_, last, buffer));
  };
  locked([&](Odometry&) {
    std::optional<Time> last = last_event_;
    for_each_piece(last, [](std::span<const Event>) {});
  });
  feed([&](Odometry& odometry) {
    for_each_piece(last_event_, [&](std::span<const Event> piece) { odometry.push(piece); });
  });
}

void Session::push_imu(const std::vector<ImuSample>& samples) {
  feed([&](Odometry& odometry) {
    for (const ImuSample& sample : samples) odometry.push(sample);
  });
}

void Session::end_imu() {
  feed([](Odometry& odometry) { odometry.end_imu(); });
}

void Session::wait() {
  watched([](Odometry& odometry) { odometry.wait(); });
}

// The listener goes with its last call: it often refers back to what holds this.
void Session::finish() {
  feed([&](Odometry& odometry) {
    odometry.finish();
    odometry.on_estimate(nullptr);
    finished_ = true;
  });
  listener_.reset();
}

std::optional<NavState> Session::predict(Time t) {
  return locked([&](Odometry& odometry) { return odometry.predict_at(t); });
}

std::vector<NavState> Session::states() {
  return watched([](Odometry& odometry) {
    odometry.wait();
    return odometry.started() ? odometry.smoother().states() : std::vector<NavState>();
  });
}

std::vector<Line> Session::lines() {
  return watched([](Odometry& odometry) {
    odometry.wait();
    return odometry.started() ? odometry.smoother().lines() : std::vector<Line>();
  });
}

Trajectory Session::camera() {
  return watched([](Odometry& odometry) {
    odometry.wait();
    Trajectory out;
    if (!odometry.started()) return out;
    for (const NavState& state : odometry.smoother().states())
      out.push_back(odometry.smoother().camera_pose(state));
    return out;
  });
}

Diagnostics Session::diagnostics() {
  return watched([](Odometry& odometry) {
    odometry.wait();
    return odometry.diagnostics();
  });
}

}  // namespace idol::python
