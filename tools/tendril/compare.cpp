// `tendril compare`: how well controllers that believe in different robot files lead one and the same plant.
// Knows nothing of how the files came about.
#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "closed_loop.h"
#include "commands.h"
#include "motion.h"
#include "motion_run.h"
#include "output.h"
#include "paths.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct CompareOptions {
  std::vector<std::string> robots;
  std::string plant, trajectory = "all", out = "tendril-compare";
  std::uint64_t seed = 1;
  bool json = false, plots = true;
};

std::atomic<bool> stop = false;

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
  Error tip, tension;
  std::uint64_t limited_cycles = 0;
  std::vector<double> time_s;
  std::vector<Eigen::Vector3d> wanted_m, tip_m;
};

Tracking Track(const std::string& controller_file, const std::string& plant_file, const Motion& motion,
               std::uint64_t seed) {
  Tracking result;
  result.controller = controller_file;
  result.plant = plant_file;
  ClosedLoopOptions options{.controller_robot = sim::LoadRobot(controller_file),
                            .plant_robot = sim::LoadRobot(plant_file),
                            .daemon = config::LoadDaemon(ConfigFile("tendrild.yaml")),
                            .plant = {.seed = seed},
                            .log_path = ""};
  options.daemon.lcm.state_every_cycles = 1000;
  options.daemon.lcm.cycle_every_cycles = 0;
  ClosedLoop loop(options);
  const auto check = [&](const CycleRecord& r) {
    if (stop) throw std::runtime_error("stopped by Ctrl-C");
    if (r.output.mode == Mode::kFault) {
      throw std::runtime_error(fmt::format("{} with {} on {} at t = {:.2f} s ({})",
                                           StatusText(r.output.status), controller_file, plant_file,
                                           loop.now_s(), StatusRemedy(r.output.status)));
    }
  };
  loop.ArmAndPretension();
  ApproachStart(loop, motion, [&](const CycleRecord& r, double) { check(r); });
  const std::uint64_t sample_every = CyclesOf(loop, 0.02);
  StreamMotion(loop, motion, [&](const CycleRecord& r, double target_s) {
    check(r);
    if (target_s < motion.judged_from_s() || target_s > motion.judged_until_s()) return;
    const Eigen::Vector3d wanted = motion.TipAt(target_s), tip = loop.plant().TipPose().p_WA;
    result.tip.Add((tip - wanted).norm());
    for (std::size_t j = 0; j < loop.plant().tendon().size(); ++j) {
      result.tension.Add(loop.plant().tendon()[j].tension_base_N -
                         r.output.tension_desired_base_N[static_cast<Eigen::Index>(j)]);
    }
    if (r.output.status != Status::kOk) ++result.limited_cycles;
    if (r.input.cycle % sample_every == 0) {
      result.time_s.push_back(target_s);
      result.wanted_m.push_back(wanted);
      result.tip_m.push_back(tip);
    }
  });
  return result;
}

ordered_json Describe(const Tracking& t, const char* role) {
  return {{"role", role},
          {"controller", t.controller},
          {"plant", t.plant},
          {"tip_rms_error_m", t.tip.rms()},
          {"tip_max_error_m", t.tip.largest},
          {"base_tension_rms_error_N", t.tension.rms()},
          {"base_tension_max_error_N", t.tension.largest},
          {"limited_cycles", t.limited_cycles}};
}

void WriteSamples(const fs::path& file, const std::vector<Tracking>& runs) {
  std::ofstream out(file);
  out << "t_s,wanted_x_m,wanted_y_m,wanted_z_m";
  for (std::size_t i = 0; i < runs.size(); ++i)
    out << fmt::format(",tip_x_m_{0},tip_y_m_{0},tip_z_m_{0}", i + 1);
  out << "\n";
  const Tracking& first = runs.front();
  for (std::size_t k = 0; k < first.time_s.size(); ++k) {
    out << fmt::format("{:.3f}", first.time_s[k]);
    for (int i = 0; i < 3; ++i) out << fmt::format(",{:.7g}", first.wanted_m[k][i]);
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
    const auto motion = MakeMotion(name, nominal.body);
    // What the control law leaves by itself, on a plant that is as the first file says; then everyone on the
    // plant.
    std::vector<Tracking> runs{Track(options.robots.front(), options.robots.front(), *motion, options.seed)};
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
             options.plots ? " and compare.png" : "");
}

}  // namespace

void AddCompareCommand(CLI::App& app) {
  auto options = std::make_shared<CompareOptions>();
  CLI::App* command = app.add_subcommand(
      "compare", "Tracking error of controllers with different robot files on the same simulated plant");
  command
      ->add_option("--robot", options->robots,
                   "a controller's robot file; may be repeated, the nominal one first")
      ->required()
      ->allow_extra_args(false);
  command->add_option("--plant", options->plant, "the plant's robot file, with what the real robot has")
      ->required();
  command->add_option("--trajectory", options->trajectory, "what to follow")
      ->check(CLI::IsMember({"circle", "planar", "all"}))
      ->capture_default_str();
  command->add_option("--out", options->out, "folder for compare.json, samples and the plot")
      ->capture_default_str();
  command->add_option("--seed", options->seed, "of the sensor noise")->capture_default_str();
  command->add_flag("--json", options->json, "print the JSON instead of the table");
  command->add_flag("!--no-plots", options->plots, "leave out the plot");
  command->callback([options] {
    std::signal(SIGINT, [](int) { stop = true; });
    std::signal(SIGTERM, [](int) { stop = true; });
    RunCompare(*options);
  });
}

}  // namespace tendril::tools
