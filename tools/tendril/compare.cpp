// `tendril compare`: how well controllers that believe in different robot files lead one and the same plant,
// or how well the control laws lead plants that differ from what they believe. Knows nothing of how files
// came about.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "commands.h"
#include "output.h"
#include "paths.h"
#include "seed_option.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/motion/motion.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct CompareOptions {
  std::vector<std::string> robots, laws, plants;
  std::string plant, trajectory = "all", out = "tendril-compare";
  std::uint64_t seed = 1;
  bool json = false, plots = true;
};

std::atomic<bool> stop = false;

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
  std::map<Status, std::uint64_t> held_back;  // cycles by why it was not led where it should be
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

std::vector<std::string> NamesOf(const std::vector<PlantKind>& kinds) {
  std::vector<std::string> names;
  for (const PlantKind& k : kinds) names.emplace_back(k.name);
  return names;
}

constexpr double kAfterFault_s = 2;
constexpr double kMuchHeldBack = 0.1;  // of the cycles: more is told

// The codes of output that is limited and of commands that are refused.
bool HoldsBack(Status status) { return static_cast<int>(status) >= 100 && static_cast<int>(status) < 300; }

Tracking Track(ClosedLoopOptions options, const Motion& motion, bool faults_end_it) {
  Tracking result;
  options.daemon.lcm.state_every_cycles = 1000;
  options.daemon.lcm.cycle_every_cycles = 0;
  const RobotParameters& robot = options.controller_robot;
  ClosedLoop loop(options);
  BendingVector bending_rad = BendingVector::Zero(2 * static_cast<Eigen::Index>(robot.body.sections.size()));
  const auto most_bend = [](const BendingVector& us_vs) {
    double most = 0;
    for (Eigen::Index k = 0; k + 1 < us_vs.size(); k += 2) most = std::max(most, us_vs.segment<2>(k).norm());
    return most;
  };
  const auto judge = [&](const CycleRecord& r) {
    if (stop) throw std::runtime_error("stopped by Ctrl-C");
    for (int j = 0; j < robot.body.tendons(); ++j) {
      const auto& drive = robot.actuation->tendons[static_cast<std::size_t>(j)];
      const double most_permille =
          1000 * drive.motor.torque_constant_NmpA * drive.drive.current_limit_A / drive.drive.rated_torque_Nm;
      const double sent = std::abs(r.output.torque_target_permille[static_cast<std::size_t>(j)]);
      result.torque_over_permille = std::max(result.torque_over_permille, sent - most_permille - 1);
      result.tension_over_N = std::max(
          {result.tension_over_N, r.output.tension_desired_base_N[j] - robot.limits.max_tension_base_N,
           r.output.tension_desired_motor_N[j] - robot.limits.max_tension_motor_N});
      if (r.output.mode == Mode::kRunning) {
        const double under_N = robot.limits.min_tension_N - r.output.tension_desired_base_N[j];
        result.tension_under_N = std::max(result.tension_under_N, under_N - 1e-9);
      }
      const sim::TendonState& truth = loop.plant().tendon()[static_cast<std::size_t>(j)];
      result.true_tension_over_N =
          std::max({result.true_tension_over_N, truth.tension_base_N - robot.limits.max_tension_base_N,
                    truth.tension_motor_N - robot.limits.max_tension_motor_N});
    }
    const double max_rad = robot.limits.max_bending_rad;
    result.bending_over_rad =
        std::max(result.bending_over_rad, most_bend(r.output.reference.position_rad) - max_rad);
    loop.plant().body().SumBending(loop.plant().q(), bending_rad);
    result.true_bending_over_rad = std::max(result.true_bending_over_rad, most_bend(bending_rad) - max_rad);
  };
  const auto check = [&](const CycleRecord& r) {
    judge(r);
    if (r.output.mode == Mode::kFault) {
      const std::string why = fmt::format("{} at t = {:.2f} s ({})", StatusText(r.output.status),
                                          loop.now_s(), StatusRemedy(r.output.status));
      throw Fault(why);
    }
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
    while (loop.now_s() < end_s) judge(loop.Step());
  }
  return result;
}

Tracking Track(const std::string& controller_file, const std::string& plant_file, const Motion& motion,
               std::uint64_t seed) {
  try {
    Tracking result = Track({.controller_robot = sim::LoadRobot(controller_file),
                             .plant_robot = sim::LoadRobot(plant_file),
                             .daemon = config::LoadDaemon(ConfigFile("tendrild.yaml")),
                             .plant = {.seed = seed},
                             .log_path = ""},
                            motion, false);
    result.controller = controller_file;
    result.plant = plant_file;
    return result;
  } catch (const Fault& fault) {
    throw std::runtime_error(fmt::format("with {} on {}: {}", controller_file, plant_file, fault.what()));
  }
}

// Of a robot that does not go where it is led its error says nothing: why it does not.
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

void Finish(const CompareOptions& options, const fs::path& out, const ordered_json& json,
            const std::vector<std::string>& lines) {
  {
    std::ofstream file(out / "compare.json");
    file << json.dump(1) << "\n";
    if (!file.flush()) throw std::runtime_error("cannot write " + (out / "compare.json").string());
  }
  if (options.plots) RunPlotScript("plot_compare.py", {out}, "the plot");
  if (options.json) {
    fmt::print("{}\n", json.dump(1));
    return;
  }
  for (const std::string& line : lines) fmt::print("{}\n", line);
  fmt::print("\n  {}: compare.json, samples{}\n", fs::absolute(out).lexically_normal().string(),
             options.plots ? " and compare.png, .svg, .pdf" : "");
}

// Every law on every plant: one row a trajectory and law, a column a plant.
void RunLaws(const CompareOptions& options) {
  const fs::path out = MakeOutputFolder(options.out);
  const std::vector<std::string> motions =
      options.trajectory == "all"
          ? std::vector<std::string>{"circle", "planar", "fast_circle", "square", "spiral"}
          : std::vector<std::string>{options.trajectory};
  std::vector<PlantKind> plants;
  for (const PlantKind& kind : PlantKinds()) {
    if (options.plants.empty() || std::count(options.plants.begin(), options.plants.end(), kind.name) > 0)
      plants.push_back(kind);
  }
  std::vector<Law> laws;
  for (const Law& law : kLaws) {
    if (options.laws.empty() || std::count(options.laws.begin(), options.laws.end(), law.name) > 0)
      laws.push_back(law);
  }
  ordered_json json = {{"version", Version()},
                       {"seed", options.seed},
                       {"laws", ordered_json::object()},
                       {"plants", ordered_json::object()},
                       {"trajectories", ordered_json::array()}};
  for (const Law& law : laws) json["laws"][law.name] = law.keys;
  for (const PlantKind& kind : plants) json["plants"][kind.name] = kind.description;
  std::vector<std::string> lines{"\n  tip error, rms / largest [mm]"};
  std::string head = fmt::format("  {:<26}", "");
  for (const PlantKind& kind : plants) head += fmt::format("{:>19}", kind.name);
  double over = 0;
  std::vector<std::string> faults, held, beyond;
  for (const std::string& name : motions) {
    const std::string file = ConfigFile(name == "planar" ? "robots/rig_90mm.yaml" : "robots/rig_60mm.yaml");
    const RobotParameters robot = sim::LoadRobot(file);
    const auto motion = MakeMotion(name, robot);
    ordered_json entry = {{"trajectory", name},
                          {"description", motion->description()},
                          {"robot", file},
                          {"runs", ordered_json::array()}};
    lines.push_back(fmt::format("\n  {}: {}\n{}", name, motion->description(), head));
    std::vector<Tracking> nominal;
    for (const Law& law : laws) {
      std::string row = fmt::format("  {:<26}", law.name);
      for (const PlantKind& kind : plants) {
        ClosedLoopOptions run{.controller_robot = robot,
                              .plant_robot = robot,
                              .daemon = config::LoadDaemon(ConfigFile("tendrild.yaml")),
                              .plant = {.seed = options.seed},
                              .log_path = ""};
        law.use(run.daemon.controller);
        // All laws get the same stream, from a sender that knows where it is going.
        run.daemon.controller.trajectory.look_ahead = false;
        for (const char* effect : kind.effects)
          run.plant_robot.effects.push_back(sim::ParseEffect(effect, run.plant_robot));
        Tracking t = Track(run, *motion, true);
        t.law = law.name;
        t.controller = file;
        t.plant = kind.name;
        over =
            std::max({over, t.tension_over_N, t.tension_under_N, t.bending_over_rad, t.torque_over_permille});
        if (const std::string why = HeldBack(t); !why.empty() && t.fault.empty())
          held.push_back(fmt::format("  {} with {} on {}: {}", name, law.name, kind.name, why));
        if (t.true_tension_over_N > 0) {
          beyond.push_back(fmt::format("  {} with {} on {}: a tendon carried {:.2f} N more than its limit",
                                       name, law.name, kind.name, t.true_tension_over_N));
        }
        if (t.true_bending_over_rad > 0) {
          beyond.push_back(fmt::format("  {} with {} on {}: the robot was bent {:.2f} rad beyond its limit",
                                       name, law.name, kind.name, t.true_bending_over_rad));
        }
        if (t.fault.empty()) {
          row += fmt::format("{:>10.3f} /{:>7.3f}", 1e3 * t.tip.rms(), 1e3 * t.tip.largest);
        } else {
          row += fmt::format("{:>19}", fmt::format("fault [{}]", faults.size() + 1));
          faults.push_back(fmt::format("  [{}] {} with {} on {}: {}", faults.size() + 1, name, law.name,
                                       kind.name, t.fault));
        }
        ordered_json described = Describe(t, kind.effects.empty() ? "own_plant" : "plant");
        described["law"] = t.law;
        described["fault"] = t.fault.empty() ? ordered_json(nullptr) : ordered_json(t.fault);
        described["limit_excess"] = {{"tension_N", t.tension_over_N},
                                     {"tension_min_N", t.tension_under_N},
                                     {"true_tension_N", t.true_tension_over_N},
                                     {"bending_rad", t.bending_over_rad},
                                     {"true_bending_rad", t.true_bending_over_rad},
                                     {"torque_permille", t.torque_over_permille}};
        entry["runs"].push_back(std::move(described));
        if (&kind == &plants.front()) nominal.push_back(std::move(t));
      }
      lines.push_back(row);
    }
    WriteSamples(out / (name + ".csv"), nominal);
    json["trajectories"].push_back(std::move(entry));
  }
  lines.emplace_back("");
  for (const std::string& fault : faults) lines.push_back(fault);
  for (const std::string& line : held) lines.push_back(line);
  lines.push_back(
      over > 0
          ? fmt::format("  a law asked for more than a limit of tension, bending or torque (by {:.3g}); see "
                        "compare.json",
                        over)
          : "  no law asked for more than a limit of tension, bending or torque");
  if (beyond.empty())
    lines.emplace_back(
        "  no tendon carried more than its limits, no robot was bent beyond its own, up to two seconds after "
        "a fault");
  for (const std::string& line : beyond) lines.push_back(line);
  Finish(options, out, json, lines);
}

void RunCompare(const CompareOptions& options) {
  const fs::path out = MakeOutputFolder(options.out);
  const std::vector<std::string> names = options.trajectory == "all"
                                             ? std::vector<std::string>{"circle", "planar"}
                                             : std::vector<std::string>{options.trajectory};
  const RobotParameters nominal = sim::LoadRobot(options.robots.front());
  ordered_json json = {{"version", Version()},
                       {"seed", options.seed},
                       {"plant", options.plant},
                       {"trajectories", ordered_json::array()}};
  std::vector<std::string> lines;
  for (const std::string& name : names) {
    const auto motion = MakeMotion(name, nominal);
    // What the control law leaves by itself, knowing all that the plant's file says; then everyone on the
    // plant.
    std::vector<Tracking> runs{Track(options.plant, options.plant, *motion, options.seed)};
    for (const std::string& robot : options.robots)
      runs.push_back(Track(robot, options.plant, *motion, options.seed));

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
    if (runs.size() > 2) {
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
      entry["closed_fraction"] = closed;
    }
    WriteSamples(out / (name + ".csv"), runs);
    json["trajectories"].push_back(std::move(entry));
  }
  Finish(options, out, json, lines);
}

}  // namespace

void AddCompareCommand(CLI::App& app) {
  auto options = std::make_shared<CompareOptions>();
  CLI::App* command = app.add_subcommand(
      "compare",
      "Tracking error: control laws on simulated plants; or, with --robot, robot files on one plant");
  command
      ->add_option("--robot", options->robots,
                   "robot file of the controller; may be repeated, the nominal one first")
      ->allow_extra_args(false);
  command->add_option("--plant", options->plant,
                      "with --robot: the plant's file, with the real robot's deviations");
  std::vector<std::string> laws;
  for (const Law& law : kLaws) laws.emplace_back(law.name);
  command->add_option("--law", options->laws, "without --robot: these laws only (repeat)")
      ->check(CLI::IsMember(laws))
      ->allow_extra_args(false);
  command->add_option("--on", options->plants, "without --robot: these plants only (repeat)")
      ->check(CLI::IsMember(NamesOf(PlantKinds())))
      ->allow_extra_args(false);
  command->add_option("--trajectory", options->trajectory, "what to follow")
      ->check(CLI::IsMember({"circle", "planar", "fast_circle", "square", "spiral", "all"}))
      ->capture_default_str();
  command->add_option("--out", options->out, "folder for compare.json, samples and the plot")
      ->capture_default_str();
  command->add_option("--seed", options->seed, "of the sensor noise")->check(Seed())->capture_default_str();
  command->add_flag("--json", options->json, "print the JSON instead of the table");
  command->add_flag("!--no-plots", options->plots, "leave out the plot");
  command->callback([options] {
    std::signal(SIGINT, [](int) { stop = true; });
    std::signal(SIGTERM, [](int) { stop = true; });
    if (options->robots.empty() != options->plant.empty())
      throw UsageError("--robot and --plant belong together; without both, the control laws are compared");
    if (!options->robots.empty() && !(options->laws.empty() && options->plants.empty()))
      throw UsageError("--law and --on go without --robot: they compare laws on the shipped rigs");
    options->robots.empty() ? RunLaws(*options) : RunCompare(*options);
  });
}

}  // namespace tendril::tools
