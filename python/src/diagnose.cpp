// The diagnosis and its report. The report is handed over as its JSON, which the package reads into
// dataclasses.
#include <nanobind/nanobind.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "data_set.h"
#include "interruptible.h"
#include "module.h"
#include "tendril/experiment/diagnosis_run.h"
#include "tendril/gap/calibrate.h"
#include "tendril/gap/calibration_text.h"
#include "tendril/gap/found_effects.h"
#include "tendril/gap/report.h"
#include "tendril/gap/track.h"
#include "tendril/sim/effects.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;
using gap::Diagnosis;

std::function<void(const std::string&, double)> ReportTo(Work* work) {
  return [work](const std::string& stage, double share) { work->Report(stage, share); };
}

Diagnosis Diagnose(const Set& set, double delta_N, double delta_m, std::uint64_t seed,
                   const std::vector<std::string>& only, const std::vector<std::string>& without, int refits,
                   int threads, bool next, const std::string& daemon, const nb::object& progress) {
  const auto work = std::make_shared<Work>();
  experiment::DiagnosisRun run;
  run.options.delta_N = delta_N;
  run.options.delta_m = delta_m;
  run.options.seed = seed;
  run.options.without = experiment::LeftOut(only, without);
  run.options.refits = refits;
  run.options.threads = threads;
  run.options.progress = ReportTo(work.get());
  run.next = next;
  run.daemon = daemon;
  const auto found = std::make_shared<Diagnosis>();
  Run(
      work, [=] { *found = experiment::RunDiagnosis(*set, run); }, progress);
  found->command = "tendril.diagnose";
  return std::move(*found);
}

gap::Calibration Calibrate(const Set& set, std::uint64_t seed, int threads, const nb::object& progress) {
  const auto work = std::make_shared<Work>();
  gap::CalibrateOptions options;
  options.seed = seed;
  options.threads = threads;
  options.progress = ReportTo(work.get());
  const auto found = std::make_shared<gap::Calibration>();
  Run(
      work, [=] { *found = gap::Calibrate(*set, options); }, progress);
  return std::move(*found);
}

std::string Track(const Set& set, double delta_N, double delta_m, std::uint64_t seed, int threads,
                  const std::map<std::string, double>& discrepancy, const nb::object& progress) {
  const auto work = std::make_shared<Work>();
  gap::TrackOptions options;
  options.delta_N = delta_N;
  options.delta_m = delta_m;
  options.seed = seed;
  options.threads = threads;
  options.discrepancy = discrepancy;
  options.progress = ReportTo(work.get());
  const auto found = std::make_shared<gap::Tracking>();
  Run(
      work, [=] { *found = gap::Track(*set, options); }, progress);
  return gap::TrackingJson(*found);
}

RobotParameters Corrected(const RobotParameters& file, const Diagnosis& diagnosis) {
  RobotParameters robot = gap::WithLearnedNumbers(file, diagnosis);
  for (const EffectSetting& effect : gap::FoundEffects(diagnosis)) robot.effects.push_back(effect);
  sim::CheckEffects(robot);
  return sim::FoldEffects(robot);
}

std::vector<std::string> EffectNames() {
  std::vector<std::string> names;
  for (const sim::Effect& effect : sim::Effects()) names.emplace_back(effect.name);
  return names;
}

}  // namespace

void AddDiagnose(nb::module_& m) {
  nb::class_<Diagnosis>(m, "Diagnosis")
      .def("json", &gap::ReportJson)
      .def("page", &gap::ReportPage)
      .def("summary", [](const Diagnosis& d) { return gap::Summary(d); })
      .def(
          "write", [](const Diagnosis& d, const std::string& folder) { gap::WriteReport(d, folder); },
          nb::arg("folder"))
      .def(
          "corrected", [](const Diagnosis& d, const RobotParameters& robot) { return Corrected(robot, d); },
          nb::arg("robot"));
  nb::class_<gap::Calibration>(m, "Calibration")
      .def("json", &gap::CalibrationJson)
      .def("text", &gap::CalibrationText)
      .def_ro("robot", &gap::Calibration::robot);
  m.def("calibrate", &Calibrate, nb::arg("set"), nb::arg("seed"), nb::arg("threads"),
        nb::arg("progress").none());
  m.def(
      "posture_states", [](const Set& set) { return gap::PostureStates(*set); }, nb::arg("set"));
  m.attr("least_posture_states") = gap::kLeastPostures;
  m.def("track", &Track, nb::arg("set"), nb::arg("delta_N"), nb::arg("delta_m"), nb::arg("seed"),
        nb::arg("threads"), nb::arg("discrepancy"), nb::arg("progress").none());
  m.def("report_style", &gap::ReportStyle);
  m.def(
      "read_report", [](const std::string& file) { return gap::ReadReport(file); }, nb::arg("file"));
  m.def("effect_names", &EffectNames);
  m.def("diagnose", &Diagnose, nb::arg("set"), nb::arg("delta_N"), nb::arg("delta_m"), nb::arg("seed"),
        nb::arg("only"), nb::arg("without"), nb::arg("refits"), nb::arg("threads"), nb::arg("next"),
        nb::arg("daemon"), nb::arg("progress").none());
}

}  // namespace tendril::python
