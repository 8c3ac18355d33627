// Evaluator, what the runs of a set can show: the cuts, what drives the replays, the channels, the tracker's
// frame.
#include "evaluator.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>

#include "clocks.h"
#include "tendril/core/parallel.h"
#include "tendril/gap/cuts.h"
#include "tracked_shape.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

// Correlation time of model errors; for states at rest, a number of states.
constexpr double kCorrelation_s = 1.0, kCorrelationStates = 5;

}  // namespace

Evaluator::Evaluator(const DataSet& set, const Options& options) : nominal_(set.robot) {
  if (!nominal_.actuation) {
    throw std::runtime_error(fmt::format(
        "robot '{}' has no actuation; accepted: a robot file with motors, tendons and sensors; use the "
        "file that the robot was controlled with",
        nominal_.name));
  }
  runs_.resize(set.runs.size());
  std::vector<std::string> trouble(runs_.size());
  const auto leave_out_the_first = [&] {
    for (std::size_t i = 0; i < trouble.size(); ++i) {
      if (!trouble[i].empty()) throw RunError(i, trouble[i]);
    }
  };
  ParallelFor(static_cast<int>(set.runs.size()), options.threads, [&](int i) {
    try {
      runs_[i] = Prepare(set.runs[i], nominal_);
    } catch (const std::runtime_error& error) {
      trouble[i] = error.what();
    }
  });
  leave_out_the_first();

  FindCuts(set);
  FindTargetsPerRow();
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    try {
      SubstituteMissingCells(runs_[i], driven_by_, nominal_.body.tendons());
    } catch (const std::runtime_error& error) {
      throw RunError(i, error.what());
    }
  }
  zeros_from_rest_ =
      std::all_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.rest_samples > 0; });
  if (zeros_from_rest_) {
    degradations_.push_back(
        fmt::format("motor positions count from where friction had left the robot when it was armed: their "
                    "zero is estimated from the {}, so encoder_offset and slack cannot be seen",
                    has(kC3) ? "load cells there" : "torques"));
  }
  ReportSensorGaps();
  ListChannels();

  nominal_motion_.resize(runs_.size());
  nominal_residuals_.resize(runs_.size());
  ParallelFor(static_cast<int>(runs_.size()), options.threads, [&](int i) {
    try {
      nominal_motion_[i] = sim::Replay(nominal_).Body(runs_[i].signals, driven_by_);
    } catch (const std::runtime_error& error) {
      trouble[i] = fmt::format("{}: {}", runs_[i].name, error.what());
    }
  });
  leave_out_the_first();
  if (has_tracker()) {
    const auto& tracker = nominal_.actuation->tracker;
    TrackerClocks clocks = CompareClocks(runs_, nominal_motion_, tracker ? tracker->delay_s : 0);
    tracker_late_s_ = std::move(clocks.late_s);
    for (std::size_t i = 0; i < runs_.size(); ++i) runs_[i].MoveTracker(-tracker_late_s_[i]);
    clocks_free_ = !clocks.note.empty();
    if (clocks_free_) degradations_.push_back(std::move(clocks.note));
    if (set.fit_frame) FindFrame();
  }
  ParallelFor(static_cast<int>(runs_.size()), options.threads, [&](int i) {
    nominal_motion_[i].shortening_m =
        MeasuredShortening(runs_[i], nominal_, nominal_motion_[i], TrackerLate(nominal_motion_[i], runs_[i]));
  });
  if (std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.signals.at_rest; })) {
    degradations_.push_back(
        fmt::format("rows are more than {} s apart: the body is assumed at rest at each row, and tendons to "
                    "slide steadily in between; motion (C5), damping and delays are not seen",
                    kQuasiStatic_s));
  }
  FindFloors(set, options);
}

// Determines the cuts that all runs together allow, and what drives the replays.
void Evaluator::FindCuts(const DataSet& set) {
  const auto every = [&](auto&& test) { return std::all_of(runs_.begin(), runs_.end(), test); };
  const auto any = [&](auto&& test) { return std::any_of(runs_.begin(), runs_.end(), test); };
  const bool motor = any([](const PreparedRun& r) { return !r.without_motors(); });
  // A run with empty columns is diagnosed with the signals that it has.
  const bool torque = every([](const PreparedRun& r) { return r.signals.torque_actual_Nm.cols() > 0; }) &&
                      any([](const PreparedRun& r) {
                        return r.LeaveSamples(r.torque_dropouts, r.signals.torque_actual_Nm.cols());
                      });
  const bool target = every([](const PreparedRun& r) { return r.signals.torque_target_Nm.cols() > 0; }) &&
                      any([](const PreparedRun& r) {
                        return r.LeaveSamples(r.target_dropouts, r.signals.torque_target_Nm.cols());
                      });
  driven_by_ = BodyInputs(runs_);
  const bool cell = driven_by_ == sim::Replay::DrivenBy::kCell;
  const bool tracker = any([](const PreparedRun& r) { return r.tracked(); });
  available_ = (torque && target ? kC1 : 0u) | (torque && motor ? kC2 : 0u) | (cell && motor ? kC3 : 0u) |
               (tracker ? kBody : 0u);
  // The body is simulated with every comparison.
  const std::vector<CutOfSet> cuts = gap::CutsOf(set);
  if (available_ == 0 || !(cell || motor)) {
    throw std::runtime_error(
        "nothing in these runs can drive the model and be compared with it: " + CutsLine(cuts) +
        "; accepted: load cells or motor positions of every tendon, and a second channel to "
        "compare with (torque, tension, or the body's shape)");
  }
  if (std::any_of(cuts.begin(), cuts.end(), [](const CutOfSet& c) { return !c.allowed(); }))
    degradations_.push_back(CutsLine(cuts));
  if (!motor) ReportMissingMotors();
  if (!target || !torque)
    degradations_.push_back("no target or actual torque: the drives' current loop (C1) is not seen");
  if (!cell) {
    degradations_.push_back(
        torque ? fmt::format("no load cell: the tensions on the body are taken from the motors and the "
                             "tendons' stretch{}; drivetrain, tendons and body (C2 to C5) cannot be told "
                             "apart by place, only by cause",
                             every([](const PreparedRun& r) { return r.signals.at_rest; })
                                 ? ""
                                 : ", and compared with torque")
               : "no load cell and no torque: the body is driven by motor positions alone; tensions are not "
                 "known, so drive and friction effects are not seen");
  }
  if (cell && !torque) degradations_.push_back("no actual torque: motors and gears (C2) are not seen");
  if (!tracker) {
    degradations_.push_back(
        "no tracker: shape and motion (C4, C5) are not seen; body effects show only through tendon "
        "displacement (C3) and "
        "cannot be told from tendon effects by place");
  }
}

// Load cells drive the body by themselves; the chain before them is not seen.
void Evaluator::ReportMissingMotors() {
  const bool before_pulleys = std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) {
    return r.signals.load_cell == LoadCellPlace::kMotorSide;
  });
  degradations_.push_back(fmt::format(
      "no motor positions: motors, gears and the tendons' stretch (C2, C3) are not seen{}",
      before_pulleys ? ", and how far a tendon slides over its pulleys follows from the body's shape and the "
                       "tendon's stretch: the direction of friction is known where the shape moves, and "
                       "without bending (all tendons pulled alike) only from the stretch"
                     : ""));
}

// Reports gaps of single sensors, one sentence per sensor with all its runs.
void Evaluator::ReportSensorGaps() {
  const auto tell = [&](std::vector<Dropout> PreparedRun::*dropouts, const char* what, const char* so) {
    std::map<std::string, std::string> tendons;  // by the rest of the sentence
    for (int j = 0; j < nominal_.body.tendons(); ++j) {
      std::string names;
      double lost_s = 0, all_s = 0;
      for (const PreparedRun& run : runs_) {
        const int samples = run.MissingSamples(run.*dropouts, j);
        if (samples == 0) continue;
        lost_s += samples * run.signals.step_s;
        all_s += run.samples() * run.signals.step_s;
        names += (names.empty() ? "" : ", ") + run.name;
      }
      if (names.empty()) continue;
      std::string& those =
          tendons[lost_s < all_s ? fmt::format(" has no data for {:.3g} of {:.3g} s: {} there ({})", lost_s,
                                               all_s, so, names)
                                 : fmt::format(" has no data, or readings more than {:.0f} ms apart: {} ({})",
                                               1e3 * kBridged_s, so, names)];
      those += fmt::format("{}{}", those.empty() ? "" : ", ", j + 1);
    }
    for (const auto& [text, those] : tendons) {
      const bool one = those.find(',') == those.npos;
      degradations_.push_back(fmt::format("the {} of tendon{} {}{}", what, one ? "" : "s", those, text));
    }
  };
  if (driven_by_ == sim::Replay::DrivenBy::kCell) {
    tell(&PreparedRun::cell_dropouts, "load cell",
         "the tension is taken from the motor and the tendon's stretch");
  }
  if (has(kC1)) tell(&PreparedRun::target_dropouts, "target torque", "its drive (C1) is not seen");
  if (has(kC1) || has(kC2))
    tell(&PreparedRun::torque_dropouts, "actual torque", "its drive and drivetrain (C1, C2) are not seen");
  const bool motors =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return !r.without_motors(); });
  if (motors)
    tell(&PreparedRun::motor_dropouts, "motor position", "its drivetrain and tendon (C2, C3) are not seen");
  std::string names;
  for (const PreparedRun& run : runs_) {
    if (has_tracker() && !run.tracked()) names += (names.empty() ? "" : ", ") + run.name;
  }
  if (!names.empty())
    degradations_.push_back("no tracker: shape and motion (C4, C5) are not seen there (" + names + ")");
}

void Evaluator::ListChannels() {
  const int tendons = nominal_.body.tendons();
  for (int j = 0; j < tendons; ++j) {
    if (has(kC1))
      channels_.push_back(
          {sim::Cut::kCurrentLoop, Quantity::kTorque, j, fmt::format("torque {}", j + 1), "N·m"});
  }
  for (int j = 0; j < tendons; ++j) {
    const char* what = has(kC3) ? "tension {} from torque" : "tension {} from torque, against stretch";
    if (has(kC2))
      channels_.push_back(
          {sim::Cut::kDrivetrain, Quantity::kTension, j, fmt::format(fmt::runtime(what), j + 1), "N"});
  }
  for (int j = 0; j < tendons; ++j) {
    if (has(kC3))
      channels_.push_back(
          {sim::Cut::kTendon, Quantity::kTension, j, fmt::format("tension {} from stretch", j + 1), "N"});
  }
  const bool turned =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return !r.tip_R.empty(); });
  const bool placed =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.tip_m.rows() > 0; });
  const bool bent =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.bending_rad.rows() > 0; });
  if (placed && !turned)
    degradations_.push_back("the tracker gives no orientation: shape from the tip's position alone");
  if (turned && !placed)
    degradations_.push_back("the tracker gives no position: shape from the tip's orientation alone");
  if (bent && !placed && !turned) {
    degradations_.push_back(
        "no tip pose: shape from the bending of each section; lengths, and effects that shift the tip "
        "without bending the body, are not seen");
  }
  for (int i = 0; i < 3; ++i) {
    if (placed)
      channels_.push_back(
          {sim::Cut::kShape, Quantity::kTipPosition, i, fmt::format("tip {}", "xyz"[i]), "m"});
  }
  for (int i = 0; i < 3; ++i) {
    if (turned)
      channels_.push_back(
          {sim::Cut::kShape, Quantity::kTipDirection, i, fmt::format("tip rotation {}", "xyz"[i]), "rad"});
  }
  for (int k = 0; bent && k < 2 * static_cast<int>(nominal_.body.sections.size()); ++k) {
    channels_.push_back({sim::Cut::kShape, Quantity::kBending, k,
                         fmt::format("bending {}_{}", k % 2 == 0 ? "us" : "vs", k / 2 + 1), "rad"});
  }
}

bool Evaluator::has_position() const {
  return std::any_of(channels_.begin(), channels_.end(),
                     [](const Channel& c) { return c.quantity == Quantity::kTipPosition; });
}

double Evaluator::Correlated(int run, int channel) const {
  return runs_[run].signals.at_rest ? kCorrelationStates
                                    : std::max(1.0, kCorrelation_s / window_s(run, channel));
}

void Evaluator::FindFrame() {
  if (!has_position()) {
    throw std::runtime_error(
        "tracker_frame: fit: no tip positions in these runs; accepted: tip positions, or a known frame");
  }
  frame_ = FitTrackerFrame(runs_, nominal_motion_);
  for (PreparedRun& run : runs_) frame_->ToBase(run);
  degradations_.push_back(frame_->Text(nominal_));
}

double Evaluator::window_s(int run, int channel) const {
  return WindowSamples(runs_[run], channels_[channel]) * runs_[run].signals.step_s;
}

unsigned Evaluator::CutsOf(const sim::Effect& effect) const {
  const bool pulleys =
      std::any_of(nominal_.actuation->tendons.begin(), nominal_.actuation->tendons.end(),
                  [](const TendonDriveParameters& p) { return !p.transmission.pulleys.empty(); });
  if (!pulleys && effect.element == sim::Element::kPulleys) return 0;
  const unsigned cuts = CutsBehind(effect.stage, effect.element);
  if (effect.stage != sim::Stage::kDrive) return cuts;
  const bool loop = effect.cut == sim::Cut::kCurrentLoop || effect.cut == sim::Cut::kClock;
  return cuts & (loop ? kC1 : kC2);
}

unsigned Evaluator::CutsBehind(sim::Stage stage, sim::Element element) const {
  // Motors are driven along their measured positions, whatever turns them.
  if (stage == sim::Stage::kDrive) return available_ & (kC1 | kC2);
  // Without a cell a tendon's effect shows in the body.
  const bool no_cell = std::any_of(runs_.begin(), runs_.end(),
                                   [](const PreparedRun& r) { return r.signals.no_cell.size() > 0; });
  if (no_cell || driven_by_ == sim::Replay::DrivenBy::kMotor) return kAllCuts;
  const bool motor_side = std::all_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) {
    return r.signals.load_cell == LoadCellPlace::kMotorSide;
  });
  switch (stage) {
    case sim::Stage::kDrive:
      break;
    case sim::Stage::kTransmission:
      if (motor_side && element == sim::Element::kTendon) {
        // Where the motor's position is missing, the stretch gives how far the tendon slides over its
        // pulleys.
        const bool slides_by_stretch = std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) {
          const std::vector<char>& none = r.signals.no_motor;
          return std::any_of(none.begin(), none.end(), [](char motor) { return motor != 0; });
        });
        return (available_ & kC3) | (slides_by_stretch ? kBody : 0u);
      }
      return kC2 | kC3 | kBody;
    case sim::Stage::kBody:
      return motor_side ? kC3 | kBody : kC2 | kC3 | kBody;
    case sim::Stage::kSensor:
      return kC2 | kC3 | kBody;
  }
  return kAllCuts;
}

}  // namespace tendril::gap
