#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>

#include "arrays.hpp"
#include "idol/jobs/convert_recording.hpp"
#include "idol/jobs/recording_run.hpp"
#include "module.hpp"
#include "options.hpp"
#include "session.hpp"

namespace idol::python {
namespace {

namespace fs = std::filesystem;

/// Lets Python's signal handlers run now and then while the GIL is released. What one raises (Ctrl-C:
/// KeyboardInterrupt) ends the job, and is raised once the job has cleared up.
class Signals {
 public:
  bool interrupted() {
    const auto now = std::chrono::steady_clock::now();
    if (raised_ || now < next_) return raised_.has_value();
    next_ = now + std::chrono::milliseconds(100);
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals() != 0) raised_.emplace();
    return raised_.has_value();
  }
  /// With the GIL.
  void rethrow() {
    if (raised_) throw py::error_already_set(*raised_);
  }

 private:
  std::chrono::steady_clock::time_point next_ = std::chrono::steady_clock::now();
  std::optional<py::error_already_set> raised_;
};

py::dict results(const RecordingRun& run) {
  const Odometry& odometry = run.odometry();
  const auto trajectories = run.recorder().trajectories(odometry);
  py::dict out;
  out["trajectory"] = trajectory_arrays(trajectories.camera);
  out["trajectory_imu"] = trajectory_arrays(trajectories.imu);
  out["trajectory_causal"] = trajectory_arrays(trajectories.camera_causal);
  out["trajectory_imu_causal"] = trajectory_arrays(trajectories.imu_causal);
  out["states"] = to_dict(odometry.started() ? odometry.smoother().states() : std::vector<NavState>());
  out["lines"] = to_dict(odometry.started() ? odometry.smoother().lines() : std::vector<Line>());
  out["stats"] = run.stats_json();
  out["warnings"] = to_dict(run.diagnostics());
  out["rig"] = run.rig();
  return out;
}

/// (results, why it is not whole or None)
py::tuple run(RunRequest request, const py::object& function) {
  Signals signals;
  std::optional<Listener> listener;
  RunListeners listeners;
  listeners.interrupted = [&] { return signals.interrupted(); };
  if (!function.is_none()) {
    listener.emplace(function.cast<py::function>());
    listeners.estimate = std::ref(*listener);
  }
  std::unique_ptr<RecordingRun> job;
  RecordingRun::Outcome outcome;
  {
    const py::gil_scoped_release unlocked;
    try {
      job = std::make_unique<RecordingRun>(std::move(request), std::move(listeners));
      outcome = job->go();
    } catch (...) {
      job.reset();  // its second thread may be waiting for the GIL
      throw;
    }
  }
  signals.rethrow();
  const bool bad = outcome.end == RecordingRun::End::kBadData;
  return py::make_tuple(results(*job), bad ? py::object(py::str(outcome.message)) : py::none());
}

/// What a RunRequest and a ConvertRequest have in common with the arguments of Python's functions.
template <class Request>
Request request_of(const fs::path& rig, const fs::path& imu_rig, double from_s, double to_s,
                   const StreamChoice& choice) {
  Request request;
  request.rig_path = rig;
  request.imu_rig_path = imu_rig;
  request.from_s = from_s;
  request.to_s = to_s;
  request.choice = choice;
  return request;
}

py::dict convert(const ConvertRequest& request) {
  Signals signals;
  Conversion done;
  {
    const py::gil_scoped_release unlocked;
    done = convert_recording(request, [&] { return signals.interrupted(); });
  }
  signals.rethrow();
  if (!done.damage.empty()) throw DataError(done.damage);
  py::dict out;
  out["events"] = done.events;
  out["imu"] = done.imu;
  out["poses"] = done.poses;
  out["warnings"] = to_dict(done.diagnostics);
  return out;
}

}  // namespace

void bind_jobs(py::module_& module) {
  module.def("run", [](const fs::path& sequence, const fs::path& out, const std::string& preset,
                       const Settings& settings, const std::optional<Rig>& rig, const fs::path& rig_path,
                       const fs::path& imu_rig, double from_s, double to_s, double rate_hz,
                       const StreamChoice& choice, const py::object& on_estimate) {
    auto request = request_of<RunRequest>(rig_path, imu_rig, from_s, to_s, choice);
    request.sequence = sequence;
    request.out = out;
    request.preset = preset;
    request.options = make_options(preset, settings);
    request.rig = rig;
    request.rate_hz = rate_hz;
    return run(std::move(request), on_estimate);
  });
  module.def("convert", [](const fs::path& in, const fs::path& out, const std::string& format, bool compress,
                           const fs::path& rig, const fs::path& imu_rig, double from_s, double to_s,
                           const StreamChoice& choice) {
    auto request = request_of<ConvertRequest>(rig, imu_rig, from_s, to_s, choice);
    request.in = in;
    request.out = out;
    request.compress = compress;
    request.format = parse_recording_format(format);
    if (!format.empty() && !request.format) throw UsageError("format '" + format + "': text, bag, hdf5 or aedat4");
    return convert(request);
  });
}

}  // namespace idol::python
