#include "tendril/experiment/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <stdexcept>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/motion/motion.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

// The robot stopped in a fault.
struct Fault : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Squares and largest of an error.
struct Error {
  double sum2 = 0, largest = 0;
  std::uint64_t count = 0;
  void Add(double x) {
    sum2 += x * x;
    largest = std::max(largest, std::abs(x));
    ++count;
  }
  double mean_square() const { return count ? sum2 / static_cast<double>(count) : 0; }
  double rms() const { return std::sqrt(mean_square()); }
};

struct Tracking {
  std::string controller, plant;  // file names
  std::string law;
  std::string fault;  // of a run that did not reach its end
  Error tip, tension;
  std::uint64_t cycles = 0, limited_cycles = 0;
  std::map<Status, std::uint64_t> held_back;  // cycles in which a limit or refusal kept it from its goal
  // Worst excess of a limit: of what was asked for; of what the plant's tendons then carried, and how it
  // bent, within the motion and the two seconds that follow a fault.
  double tension_over_N = 0, tension_under_N = 0, true_tension_over_N = 0, bending_over_rad = 0,
         true_bending_over_rad = 0, torque_over_permille = 0;
  std::vector<double> time_s;
  std::vector<Eigen::Vector3d> wanted_m, tip_m;
};

// How a law is switched on in the daemon's file.
struct Law {
  const char* name;
  const char* keys;  // for people
  void (*use)(ControllerParameters& parameters);
};
constexpr Law kLaws[] = {
    {"paper", "law: paper", [](ControllerParameters& p) { p.law = ControlLaw::kPaper; }},
    {"equilibrium", "law: equilibrium", [](ControllerParameters& p) { p.law = ControlLaw::kEquilibrium; }},
    {"tension", "law: equilibrium, tension_feedback: on",
     [](ControllerParameters& p) {
       p.law = ControlLaw::kEquilibrium;
       p.tension_feedback = true;
     }},
    {"shape", "law: equilibrium, tension_feedback: on, shape_feedback: on",
     [](ControllerParameters& p) {
       p.law = ControlLaw::kEquilibrium;
       p.tension_feedback = p.shape_feedback = true;
     }},
    {"tip", "law: equilibrium, tension_feedback: on, shape_feedback: on, tip_feedback: on",
     [](ControllerParameters& p) {
       p.law = ControlLaw::kEquilibrium;
       p.tension_feedback = p.shape_feedback = p.tip_feedback = true;
     }},
};

// How a plant differs from the file that the controller believes, in the words of `tendril gap simulate`.
struct PlantKind {
  const char* name;
  const char* description;
  std::vector<const char*> effects;
};
const std::vector<PlantKind>& PlantKinds() {
  static const std::vector<PlantKind> kinds = {
      {"nominal", "as the controller's file says", {}},
      {"stiffness", "backbone 20 % stiffer", {"bending_stiffness scale=1.2"}},
      {"payload", "2 g more at the tip", {"tip_payload mass_kg=0.002"}},
      {"friction",
       "friction of pulleys and motors doubled",
       {"capstan_alpha scale=2", "motor_coulomb scale=2"}},
      {"stretch", "tendons half as stiff", {"tendon_stiffness scale=0.5"}},
  };
  return kinds;
}

constexpr double kAfterFault_s = 2;
constexpr double kMuchHeldBack = 0.1;  // share of the cycles above which it is reported

// The codes of output that is limited and of commands that are refused.
bool HoldsBack(Status status) { return static_cast<int>(status) >= 100 && static_cast<int>(status) < 300; }

// Excess of limits in every cycle: of what the controller asks for, and of what the plant carries.
class LimitJudge {
 public:
  LimitJudge(const RobotParameters& robot, ClosedLoop& loop, Tracking& result)
      : robot_(robot),
        loop_(loop),
        result_(result),
        bending_rad_(BendingVector::Zero(2 * static_cast<Eigen::Index>(robot.body.sections.size()))) {}

  void Judge(const CycleRecord& r) {
    for (int j = 0; j < robot_.body.tendons(); ++j) JudgeTendon(r, j);
    const double max_rad = robot_.limits.max_bending_rad;
    Raise(result_.bending_over_rad, MostBend(r.output.reference.position_rad) - max_rad);
    loop_.plant().body().SumBending(loop_.plant().q(), bending_rad_);
    Raise(result_.true_bending_over_rad, MostBend(bending_rad_) - max_rad);
  }

 private:
  static void Raise(double& most, double x) { most = std::max(most, x); }
  static double MostBend(const BendingVector& us_vs) {
    double most = 0;
    for (Eigen::Index k = 0; k + 1 < us_vs.size(); k += 2) most = std::max(most, us_vs.segment<2>(k).norm());
    return most;
  }

  void JudgeTendon(const CycleRecord& r, int j) {
    const auto& drive = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    const LimitParameters& limits = robot_.limits;
    const double most_permille =
        1000 * drive.motor.torque_constant_NmpA * drive.drive.current_limit_A / drive.drive.rated_torque_Nm;
    const double sent = std::abs(r.output.torque_target_permille[static_cast<std::size_t>(j)]);
    Raise(result_.torque_over_permille, sent - most_permille - 1);
    Raise(result_.tension_over_N, r.output.tension_desired_base_N[j] - limits.max_tension_base_N);
    Raise(result_.tension_over_N, r.output.tension_desired_motor_N[j] - limits.max_tension_motor_N);
    if (r.output.mode == Mode::kRunning)
      Raise(result_.tension_under_N, limits.min_tension_N - r.output.tension_desired_base_N[j] - 1e-9);
    const sim::TendonState& truth = loop_.plant().tendon()[static_cast<std::size_t>(j)];
    Raise(result_.true_tension_over_N, truth.tension_base_N - limits.max_tension_base_N);
    Raise(result_.true_tension_over_N, truth.tension_motor_N - limits.max_tension_motor_N);
  }

  const RobotParameters& robot_;
  ClosedLoop& loop_;
  Tracking& result_;
  BendingVector bending_rad_;
};

void AddErrors(Tracking& result, const ClosedLoop& loop, const CycleRecord& r, const Eigen::Vector3d& wanted,
               const Eigen::Vector3d& tip) {
  result.tip.Add((tip - wanted).norm());
  for (std::size_t j = 0; j < loop.plant().tendon().size(); ++j) {
    result.tension.Add(loop.plant().tendon()[j].tension_base_N -
                       r.output.tension_desired_base_N[static_cast<Eigen::Index>(j)]);
  }
  ++result.cycles;
  if (r.output.status != Status::kOk) ++result.limited_cycles;
  Status why = r.output.command_status;
  for (const Status s : r.output.reported) why = HoldsBack(s) && !HoldsBack(why) ? s : why;
  if (HoldsBack(why)) ++result.held_back[why];
}

Tracking RunAndTrack(ClosedLoopOptions options, const motion::Motion& motion, bool faults_end_it,
                     const std::atomic<bool>* stop) {
  Tracking result;
  options.daemon.lcm.state_every_cycles = 1000;
  options.daemon.lcm.cycle_every_cycles = 0;
  ClosedLoop loop(options);
  LimitJudge limits(options.controller_robot, loop, result);
  const auto check = [&](const CycleRecord& r) {
    if (stop && *stop) throw std::runtime_error("stopped by Ctrl-C");
    limits.Judge(r);
    if (r.output.mode != Mode::kFault) return;
    throw Fault(fmt::format("{} at t = {:.2f} s ({})", StatusText(r.output.status), loop.now_s(),
                            StatusRemedy(r.output.status)));
  };
  try {
    loop.ArmAndPretension();
    ApproachStart(loop, motion, [&](const CycleRecord& r, double) { check(r); });
    const std::uint64_t sample_every = CyclesOf(loop, 0.02);
    StreamMotion(
        loop, motion,
        [&](const CycleRecord& r, double target_s) {
          check(r);
          if (target_s < motion.judged_from_s() || target_s > motion.judged_until_s()) return;
          const Eigen::Vector3d wanted = motion.TipAt(target_s), tip = loop.plant().TipPose().p_WA;
          AddErrors(result, loop, r, wanted, tip);
          if (r.input.cycle % sample_every == 0) {
            result.time_s.push_back(target_s);
            result.wanted_m.push_back(wanted);
            result.tip_m.push_back(tip);
          }
        },
        loop.sender_lead_s());
  } catch (const Fault& fault) {
    if (!faults_end_it) throw;
    result.fault = fault.what();
    // A fault lets go of the robot; its tendons are judged until that is over.
    const double end_s = loop.now_s() + kAfterFault_s;
    while (loop.now_s() < end_s) {
      if (stop && *stop) throw std::runtime_error("stopped by Ctrl-C");
      limits.Judge(loop.Step());
    }
  }
  return result;
}

Tracking RunAndTrack(const std::string& controller_file, const std::string& plant_file,
                     const motion::Motion& motion, const CompareSetup& setup) {
  try {
    Tracking result = RunAndTrack({.controller_robot = sim::LoadRobot(controller_file),
                                   .plant_robot = sim::LoadRobot(plant_file),
                                   .daemon = config::LoadDaemon(setup.config_file("tendrild.yaml")),
                                   .plant = {.seed = setup.seed},
                                   .log_path = ""},
                                  motion, false, setup.stop);
    result.controller = controller_file;
    result.plant = plant_file;
    return result;
  } catch (const Fault& fault) {
    throw std::runtime_error(fmt::format("with {} on {}: {}", controller_file, plant_file, fault.what()));
  }
}

// Why a robot was kept from its goals, in which case its error says nothing about the law; else empty.
std::string HeldBack(const Tracking& t) {
  const auto most = std::max_element(t.held_back.begin(), t.held_back.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most == t.held_back.end()) return "";
  const double share = static_cast<double>(most->second) / static_cast<double>(t.cycles);
  if (share < kMuchHeldBack) return "";
  return fmt::format("limited or refused in {:.0f} % of its cycles: {} ({}); {}", 100 * share,
                     StatusText(most->first), static_cast<int>(most->first), StatusRemedy(most->first));
}

ordered_json Describe(const Tracking& t, const char* role) {
  ordered_json held_back = ordered_json::object();
  for (const auto& [status, cycles] : t.held_back)
    held_back[std::to_string(static_cast<int>(status))] = cycles;
  return {{"role", role},
          {"controller", t.controller},
          {"plant", t.plant},
          {"tip_rms_error_m", t.tip.rms()},
          {"tip_max_error_m", t.tip.largest},
          {"base_tension_rms_error_N", t.tension.rms()},
          {"base_tension_max_error_N", t.tension.largest},
          {"cycles", t.cycles},
          {"limited_cycles", t.limited_cycles},
          {"held_back", held_back}};
}

/// A run that ended in a fault has samples up to there.
void WriteSamples(const fs::path& file, const std::vector<Tracking>& runs) {
  std::ofstream out(file);
  out << "t_s,wanted_x_m,wanted_y_m,wanted_z_m";
  for (std::size_t i = 0; i < runs.size(); ++i)
    out << fmt::format(",tip_x_m_{0},tip_y_m_{0},tip_z_m_{0}", i + 1);
  out << "\n";
  const Tracking& longest = *std::max_element(runs.begin(), runs.end(), [](const auto& a, const auto& b) {
    return a.time_s.size() < b.time_s.size();
  });
  for (std::size_t k = 0; k < longest.time_s.size(); ++k) {
    out << fmt::format("{:.3f}", longest.time_s[k]);
    for (int i = 0; i < 3; ++i) out << fmt::format(",{:.7g}", longest.wanted_m[k][i]);
    for (const Tracking& run : runs) {
      for (int i = 0; i < 3; ++i) {
        if (k < run.tip_m.size()) {
          out << fmt::format(",{:.7g}", run.tip_m[k][i]);
        } else {
          out << ",";
        }
      }
    }
    out << "\n";
  }
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

// Every law on every plant: one row a trajectory and law, a column a plant.
class LawTable {
 public:
  LawTable(std::vector<Law> laws, std::vector<PlantKind> plants, const CompareSetup& setup)
      : laws_(std::move(laws)), plants_(std::move(plants)), setup_(setup) {
    json_ = {{"version", Version()},
             {"seed", setup.seed},
             {"laws", ordered_json::object()},
             {"plants", ordered_json::object()},
             {"trajectories", ordered_json::array()}};
    for (const Law& law : laws_) json_["laws"][law.name] = law.keys;
    for (const PlantKind& kind : plants_) json_["plants"][kind.name] = kind.description;
    for (const PlantKind& kind : plants_) head_ += fmt::format("{:>19}", kind.name);
  }

  void Run(const std::string& name) {
    const std::string file =
        setup_.config_file(name == "planar" ? "robots/rig_90mm.yaml" : "robots/rig_60mm.yaml");
    const RobotParameters robot = sim::LoadRobot(file);
    const auto motion = motion::MakeMotion(name, robot);
    ordered_json entry = {{"trajectory", name},
                          {"description", motion->description()},
                          {"robot", file},
                          {"runs", ordered_json::array()}};
    lines_.push_back(fmt::format("\n  {}: {}\n{}", name, motion->description(), head_));
    std::vector<Tracking> nominal;
    for (const Law& law : laws_) {
      std::string row = fmt::format("  {:<26}", law.name);
      for (const PlantKind& kind : plants_) {
        Tracking t = TrackOn(kind, law, robot, *motion);
        t.controller = file;
        Remark(name, t);
        row += Cell(name, t);
        entry["runs"].push_back(WithLaw(t, kind));
        if (&kind == &plants_.front()) nominal.push_back(std::move(t));
      }
      lines_.push_back(row);
    }
    WriteSamples(setup_.folder / (name + ".csv"), nominal);
    json_["trajectories"].push_back(std::move(entry));
  }

  Comparison Finish() {
    lines_.emplace_back("");
    for (const auto* remarks : {&faults_, &held_})
      lines_.insert(lines_.end(), remarks->begin(), remarks->end());
    lines_.push_back(
        over_ > 0 ? fmt::format(
                        "  a law asked for more than a limit of tension, bending or torque (by {:.3g}); see "
                        "compare.json",
                        over_)
                  : "  no law asked for more than a limit of tension, bending or torque");
    if (beyond_.empty())
      lines_.emplace_back(
          "  no tendon carried more than its limits, no robot was bent beyond its own, up to two seconds "
          "after "
          "a fault");
    lines_.insert(lines_.end(), beyond_.begin(), beyond_.end());
    return {json_, lines_};
  }

 private:
  Tracking TrackOn(const PlantKind& kind, const Law& law, const RobotParameters& robot,
                   const motion::Motion& motion) const {
    ClosedLoopOptions run{.controller_robot = robot,
                          .plant_robot = robot,
                          .daemon = config::LoadDaemon(setup_.config_file("tendrild.yaml")),
                          .plant = {.seed = setup_.seed},
                          .log_path = ""};
    law.use(run.daemon.controller);
    // All laws get the same stream, from a sender that knows where it is going.
    run.daemon.controller.trajectory.look_ahead = false;
    for (const char* effect : kind.effects)
      run.plant_robot.effects.push_back(sim::ParseEffect(effect, run.plant_robot));
    Tracking t = RunAndTrack(run, motion, true, setup_.stop);
    t.law = law.name;
    t.plant = kind.name;
    return t;
  }

  void Remark(const std::string& name, const Tracking& t) {
    over_ =
        std::max({over_, t.tension_over_N, t.tension_under_N, t.bending_over_rad, t.torque_over_permille});
    const std::string which = fmt::format("{} with {} on {}", name, t.law, t.plant);
    if (const std::string why = HeldBack(t); !why.empty() && t.fault.empty())
      held_.push_back(fmt::format("  {}: {}", which, why));
    if (t.true_tension_over_N > 0) {
      beyond_.push_back(
          fmt::format("  {}: a tendon carried {:.2f} N more than its limit", which, t.true_tension_over_N));
    }
    if (t.true_bending_over_rad > 0) {
      beyond_.push_back(fmt::format("  {}: the robot was bent {:.2f} rad beyond its limit", which,
                                    t.true_bending_over_rad));
    }
  }

  std::string Cell(const std::string& name, const Tracking& t) {
    if (t.fault.empty()) return fmt::format("{:>10.3f} /{:>7.3f}", 1e3 * t.tip.rms(), 1e3 * t.tip.largest);
    faults_.push_back(
        fmt::format("  [{}] {} with {} on {}: {}", faults_.size() + 1, name, t.law, t.plant, t.fault));
    return fmt::format("{:>19}", fmt::format("fault [{}]", faults_.size()));
  }

  static ordered_json WithLaw(const Tracking& t, const PlantKind& kind) {
    ordered_json described = Describe(t, kind.effects.empty() ? "own_plant" : "plant");
    described["law"] = t.law;
    described["fault"] = t.fault.empty() ? ordered_json(nullptr) : ordered_json(t.fault);
    described["limit_excess"] = {{"tension_N", t.tension_over_N},
                                 {"tension_min_N", t.tension_under_N},
                                 {"true_tension_N", t.true_tension_over_N},
                                 {"bending_rad", t.bending_over_rad},
                                 {"true_bending_rad", t.true_bending_over_rad},
                                 {"torque_permille", t.torque_over_permille}};
    return described;
  }

  std::vector<Law> laws_;
  std::vector<PlantKind> plants_;
  const CompareSetup& setup_;
  ordered_json json_;
  std::string head_ = fmt::format("  {:<26}", "");
  std::vector<std::string> lines_{"\n  tip error, rms / largest [mm]"};
  std::vector<std::string> faults_, held_, beyond_;
  double over_ = 0;  // worst excess of a limit that was asked for
};

// Those of the rows that are asked for by name; all when none is.
template <class Rows>
auto Chosen(const Rows& rows, const std::vector<std::string>& names) {
  std::vector<std::decay_t<decltype(*std::begin(rows))>> chosen;
  for (const auto& row : rows) {
    if (names.empty() || std::count(names.begin(), names.end(), row.name) > 0) chosen.push_back(row);
  }
  return chosen;
}

template <class Rows>
std::vector<std::string> NamesOf(const Rows& rows) {
  std::vector<std::string> names;
  for (const auto& row : rows) names.emplace_back(row.name);
  return names;
}

// What each further robot file closes of the error that the plant's difference adds to the first.
ordered_json ClosedFraction(const std::vector<Tracking>& runs, std::vector<std::string>& lines) {
  const double floor = runs[0].tip.mean_square(), before = runs[1].tip.mean_square();
  ordered_json closed = ordered_json::array();
  for (std::size_t i = 2; i < runs.size(); ++i) {
    // Undefined when there was no gap to close.
    const bool gap = before > 1.01 * floor;
    const double share = 1 - (runs[i].tip.mean_square() - floor) / (before - floor);
    closed.push_back(gap ? ordered_json(share) : ordered_json(nullptr));
    lines.push_back(
        gap ? fmt::format("  {} closes {:.1f} % of the mean square that the plant's difference adds",
                          fs::path(runs[i].controller).filename().string(), 100 * share)
            : "  the plant's difference adds no error that could be closed");
  }
  return closed;
}

}  // namespace

std::vector<std::string> ComparedLaws() { return NamesOf(kLaws); }
std::vector<std::string> ComparedPlants() { return NamesOf(PlantKinds()); }

Comparison CompareLaws(const std::vector<std::string>& laws, const std::vector<std::string>& plants,
                       const std::vector<std::string>& trajectories, const CompareSetup& setup) {
  LawTable table(Chosen(kLaws, laws), Chosen(PlantKinds(), plants), setup);
  for (const std::string& name : trajectories) table.Run(name);
  return table.Finish();
}

Comparison CompareRobots(const std::vector<std::string>& robots, const std::string& plant,
                         const std::vector<std::string>& trajectories, const CompareSetup& setup) {
  const RobotParameters nominal = sim::LoadRobot(robots.front());
  ordered_json json = {{"version", Version()},
                       {"seed", setup.seed},
                       {"plant", plant},
                       {"trajectories", ordered_json::array()}};
  std::vector<std::string> lines;
  for (const std::string& name : trajectories) {
    const auto motion = motion::MakeMotion(name, nominal);
    // What the control law leaves by itself, knowing all that the plant's file says; then everyone on the
    // plant.
    std::vector<Tracking> runs{RunAndTrack(plant, plant, *motion, setup)};
    for (const std::string& robot : robots) runs.push_back(RunAndTrack(robot, plant, *motion, setup));

    ordered_json entry = {
        {"trajectory", name}, {"description", motion->description()}, {"runs", ordered_json::array()}};
    lines.push_back(fmt::format("\n  {}\n  {:<44}{:>11}{:>11}{:>13}{:>13}", motion->description(), "",
                                "tip rms", "tip max", "tension rms", "tension max"));
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const Tracking& t = runs[i];
      entry["runs"].push_back(Describe(t, i == 0 ? "own_plant" : "plant"));
      const std::string what =
          fmt::format("{}{}", fs::path(t.controller).filename().string(), i == 0 ? ", on its own plant" : "");
      lines.push_back(fmt::format("  {:<44}{:>8.3f} mm{:>8.3f} mm{:>11.3f} N{:>11.3f} N", what,
                                  1e3 * t.tip.rms(), 1e3 * t.tip.largest, t.tension.rms(),
                                  t.tension.largest));
      if (const std::string why = HeldBack(t); !why.empty()) lines.push_back("    " + why);
    }
    if (runs.size() > 2) entry["closed_fraction"] = ClosedFraction(runs, lines);
    WriteSamples(setup.folder / (name + ".csv"), runs);
    json["trajectories"].push_back(std::move(entry));
  }
  return {json, lines};
}

}  // namespace tendril::experiment
