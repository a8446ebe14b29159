#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <memory>
#include <mutex>

#include "arrays.hpp"
#include "idol/eval/evaluation_input.hpp"
#include "idol/eval/evaluation_output.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/trajectory_io.hpp"
#include "module.hpp"

namespace idol::python {
namespace {

namespace fs = std::filesystem;

/// A reader that more than one thread may ask.
class PacketReader {
 public:
  PacketReader(const fs::path& path, const ReaderOptions& options) : reader_(open_reader(path, options)) {}

  std::optional<Packet> next() {
    const py::gil_scoped_release unlocked;
    const std::lock_guard lock(mutex_);
    return reader_->next();
  }
  template <class Ask>
  auto ask(Ask&& ask) {
    const py::gil_scoped_release unlocked;
    const std::lock_guard lock(mutex_);
    return ask(*reader_);
  }

 private:
  std::mutex mutex_;
  std::unique_ptr<Reader> reader_;
};

py::tuple next_packet(PacketReader& reader) {
  auto packet = reader.next();
  if (!packet) throw py::stop_iteration();
  return py::make_tuple(adopt(std::move(packet->events), event_dtype()),
                        adopt(std::move(packet->imu), imu_dtype()));
}

std::unique_ptr<PacketReader> open(const fs::path& path, std::pair<int, int> size, double from_s, double to_s,
                                   std::size_t packet_events, const StreamChoice& choice) {
  ReaderOptions options;
  options.width = size.first;
  options.height = size.second;
  options.from_s = from_s;
  options.to_s = to_s;
  options.need_imu = false;
  options.imu_if_present = true;
  options.need_events = false;
  options.packet_events = packet_events;
  options.choice = choice;
  const py::gil_scoped_release unlocked;
  return std::make_unique<PacketReader>(path, options);
}

void bind_trajectories(py::module_& module) {
  module.def("read_groundtruth", [](const fs::path& path, const StreamChoice& choice) -> py::object {
    const auto truth = [&] {
      const py::gil_scoped_release unlocked;
      return read_groundtruth(path, choice);
    }();
    return truth ? py::object(trajectory_arrays(*truth)) : py::none();
  });
  module.def("load_groundtruth", [](const fs::path& path) {
    const GroundTruth truth = load_groundtruth(path);
    return py::make_tuple(trajectory_arrays(truth.trajectory), truth.of_imu);
  });
  module.def("load_estimate", [](const fs::path& path, bool of_imu) {
    return trajectory_arrays(load_estimate(estimate_file(path, GroundTruth{{}, {}, of_imu})));
  });
  module.def("write_trajectory",
             [](const fs::path& path, const py::array_t<Time>& t, const py::array_t<double>& p,
                const py::array_t<double>& q) { write_trajectory(path, trajectory_from_arrays(t, p, q)); });
}

}  // namespace

void bind_recordings(py::module_& module) {
  py::class_<StreamChoice>(module, "StreamChoice")
      .def(py::init(
          [](std::string events, std::string imu, std::string truth, fs::path imu_file, std::string camera) {
            return StreamChoice{std::move(events), std::move(imu), std::move(truth), std::move(imu_file),
                                std::move(camera)};
          }));
  py::class_<PacketReader>(module, "PacketReader")
      .def(py::init(&open))
      .def("next", &next_packet)
      .def("progress", [](PacketReader& r) { return r.ask([](Reader& x) { return x.progress(); }); })
      .def("first_stamp", [](PacketReader& r) { return r.ask([](Reader& x) { return x.first_stamp(); }); })
      .def("warnings",
           [](PacketReader& r) { return to_dict(r.ask([](Reader& x) { return x.diagnostics(); })); });
  bind_trajectories(module);
  using Trajectories = std::tuple<py::array_t<Time>, py::array_t<double>, py::array_t<double>>;
  module.def("evaluate",
             [](const Trajectories& estimate, const Trajectories& truth,
                const std::vector<std::string>& protocols, bool interpolate, std::optional<double> until_s) {
               const Trajectory e = std::apply(trajectory_from_arrays, estimate);
               const Trajectory t = std::apply(trajectory_from_arrays, truth);
               EvaluationOptions options;
               options.protocols = protocols;
               options.interpolate = interpolate;
               options.until_s = until_s;
               const py::gil_scoped_release unlocked;
               return evaluation_json(evaluate(e, t, options));
             });
}

}  // namespace idol::python
