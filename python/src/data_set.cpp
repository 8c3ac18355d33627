// Measured runs: read from files and tables, written, and looked at as arrays.
#include "data_set.h"

#include <fmt/format.h>
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "interruptible.h"
#include "module.h"
#include "tendril/core/load_cell_place.h"
#include "tendril/gap/cuts.h"
#include "tendril/gap/health.h"
#include "tendril/gap/health_lines.h"
#include "tendril/gap/import.h"
#include "tendril/gap/run_table.h"
#include "tendril/gap/set_folder.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;
using Eigen::MatrixXd;
using gap::Run;

/// Reading takes a while: without the GIL, and ended by Ctrl-C.
template <class Read>
Set InBackground(Read read) {
  const auto set = std::make_shared<std::optional<gap::DataSet>>();
  python::Run(
      std::make_shared<Work>(), [set, read = std::move(read)] { *set = read(); }, nb::none());
  return Set(std::move(**set));
}

Set Load(const std::vector<std::string>& paths, const std::string& robot_file, bool same_robot) {
  const auto other = same_robot ? gap::OtherRobot::kNoted : gap::OtherRobot::kRefused;
  return InBackground([=] { return gap::LoadLogs(paths, robot_file, other); });
}

Set Import(const std::string& map, const std::vector<std::string>& tables, const RobotParameters& robot) {
  return InBackground([=] { return gap::ImportTables(map, tables, robot); });
}

Set Named(const Set& set, const std::string& name, const std::string& folder) {
  gap::DataSet named = *set;
  named.name = name;
  // Notes name the files that stood for tables in memory only for a moment.
  const auto shorten = [&](std::vector<std::string>& lines) {
    for (std::string& line : lines) {
      for (std::size_t at = line.find(folder); at != line.npos; at = line.find(folder))
        line.erase(at, folder.size());
    }
  };
  shorten(named.notes);
  for (Run& run : named.runs) shorten(run.notes), shorten(run.warnings);
  return Set(std::move(named));
}

Set WithBefore(const Set& set, const Set& before) {
  gap::DataSet both = *set;
  gap::CompareWithBefore(both, *before);
  return Set(std::move(both));
}

void Write(const Set& set, const std::string& folder, bool overwrite) {
  const nb::gil_scoped_release released;
  const gap::SetFolder to(folder, overwrite, {});
  std::vector<std::string> names;
  for (const Run& run : set->runs) names.push_back(run.name);
  to.CheckNames(names);
  to.Write(*set);
}

std::pair<std::vector<std::string>, MatrixXd> Table(const Run& run) {
  gap::RunTable table = gap::TableOf(run);
  return {std::move(table.names), std::move(table.values)};
}

/// None: not measured.
std::optional<MatrixXd> Measured(const MatrixXd& channel) {
  if (channel.cols() == 0) return std::nullopt;
  return channel;
}

template <MatrixXd Run::*channel>
std::optional<MatrixXd> Channel(const Run& run) {
  return Measured(run.*channel);
}

void AddRunClass(nb::module_& m) {
  nb::class_<Run>(m, "Run",
                  "One measured run with S samples. SI units, pulling positive, motor shaft; NaN: no new "
                  "value of a slower sensor;\n"
                  "None: not measured.")
      .def_ro("name", &Run::name, "Name of the run: its file's, without the extension.")
      .def_ro("family", &Run::family, "Kind of motion: 'triangle', 'circle', ...; 'unknown' where not given.")
      .def_ro("repeat_of", &Run::repeat_of, "Run that this one repeats unchanged, or empty.")
      .def_ro("before", &Run::before, "Run of the same commands from before the robot changed, or empty.")
      .def_ro("sha256", &Run::sha256, "Of the source file; empty for a run that is from none.")
      .def_ro("notes", &Run::notes, "Remarks on the file, one line each.")
      .def_ro("warnings", &Run::warnings, "What was dropped or repaired on reading, one line each.")
      .def_prop_ro(
          "load_cell", [](const Run& r) { return std::string(LoadCellPlaceText(r.load_cell)); },
          "Place of the load cells: 'none', 'motor_side' or 'robot_side'.")
      .def_prop_ro(
          "time", [](const Run& r) { return r.time_s; }, "Time [s], (S,).")
      .def_prop_ro("torque_target", &Channel<&Run::torque_target_Nm>,
                   "Commanded torque at the motor shaft [N m], (S, M).")
      .def_prop_ro("torque_actual", &Channel<&Run::torque_actual_Nm>,
                   "Reported torque at the motor shaft [N m], (S, M).")
      .def_prop_ro("motor_position", &Channel<&Run::motor_position_rad>,
                   "Angle of the motor shaft [rad], (S, M).")
      .def_prop_ro("tension", &Channel<&Run::tension_N>,
                   "Load cells, on their side of the pulleys [N], (S, M).")
      .def_prop_ro("tip", &Channel<&Run::tip_m>, "Tip by the tracker, in its frame [m], (S, 3).")
      .def_prop_ro("tip_orientation", &Channel<&Run::tip_quaternion>,
                   "Orientation of the tip, unit quaternion w, x, y, z, (S, 4).")
      .def_prop_ro("disks", &Channel<&Run::disks_m>,
                   "Centre of every disk in the tracker's frame [m], x, y, z a disk, (S, 3D).")
      .def_prop_ro("disk_orientations", &Channel<&Run::disk_quaternion>,
                   "Orientation of every disk, unit quaternion w, x, y, z a disk, (S, 4D).")
      .def_prop_ro("bending", &Channel<&Run::bending_rad>,
                   "us, vs of each section, where the log has it [rad], (S, 2K).")
      .def("__repr__", [](const Run& r) {
        const double end_s = r.time_s.size() ? r.time_s[r.time_s.size() - 1] : 0;
        return fmt::format("<Run '{}' ({}): {} samples to {:g} s>", r.name, r.family, r.time_s.size(), end_s);
      });
}

}  // namespace

void AddDataSet(nb::module_& m) {
  AddRunClass(m);
  nb::class_<Set>(m, "Set")
      .def_prop_ro("name", [](const Set& s) { return s->name; })
      .def_prop_ro("robot", [](const Set& s) { return s->robot; })
      .def_prop_ro("notes", [](const Set& s) { return s->notes; })
      .def_prop_ro("runs", [](const Set& s) { return s->runs; })
      .def("cuts", [](const Set& s) { return gap::CutsLine(gap::CutsOf(*s)); })
      .def("health", [](const Set& s) { return gap::FindingLines(gap::CheckHealth(*s)); })
      .def("errors", [](const Set& s) { return gap::ErrorLines(gap::CheckHealth(*s)); })
      .def("named", &Named, nb::arg("name"), nb::arg("folder"))
      .def("with_before", &WithBefore, nb::arg("before"))
      .def("write", &Write, nb::arg("folder"), nb::arg("overwrite"));
  m.def("load_set", &Load, nb::arg("paths"), nb::arg("robot_file"), nb::arg("same_robot"));
  m.def("import_tables", &Import, nb::arg("map"), nb::arg("tables"), nb::arg("robot"));
  m.def("table_of", &Table, nb::arg("run"));
}

}  // namespace tendril::python
