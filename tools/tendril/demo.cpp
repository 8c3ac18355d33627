// `tendril demo`: the paper's robot follows a commanded circle and a planar bend. Chooses files and shows
// the progress; the run itself is experiment's.
#include "tendril/experiment/demo.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "commands.h"
#include "output.h"
#include "paths.h"
#include "seed_option.h"
#include "stop_signals.h"
#include "tendril/config/config.h"
#include "tendril/model/held_directions.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct DemoOptions {
  std::string robot, plant, trajectory = "all", compensation = "on", out = "tendril-demo";
  std::uint64_t seed = 1;
  bool plots = true;
};

class DemoBar {
 public:
  explicit DemoBar(std::string name) : name_(std::move(name)), terminal_(isatty(STDERR_FILENO)) {}
  void Show(const experiment::DemoProgress& p) {
    const auto& [share, simulated_s, wall_s, tip_error_m, last] = p;
    const int percent = static_cast<int>(100 * share);
    if (!last && (percent >= 100 || percent < shown_ + (terminal_ ? 1 : 25))) return;
    shown_ = percent;
    std::string bar(static_cast<std::size_t>(std::clamp(percent, 0, 100) / 4), '#');
    bar.resize(25, '.');
    const std::string line =
        fmt::format("{}{:>8} [{}] {:3d} %  {:5.1f} s simulated, {:4.0f} x real time, tip error {:6.3f} mm{}",
                    terminal_ ? "\r" : "", name_, bar, percent, simulated_s,
                    wall_s > 0 ? simulated_s / wall_s : 0, tip_error_m * 1e3, terminal_ && !last ? "" : "\n");
    std::fputs(line.c_str(), stderr);  // whatever becomes of it: showing progress must not end the run
  }

 private:
  std::string name_;
  bool terminal_;
  int shown_ = -25;
};

ordered_json RunMotion(const std::string& name, const DemoOptions& options, const fs::path& folder) {
  const std::string default_file =
      ConfigFile(name == "circle" ? "robots/rig_60mm.yaml" : "robots/rig_90mm.yaml");
  const std::string robot_file = options.robot.empty() ? default_file : options.robot;
  DemoBar bar(name);
  return experiment::RunDemo(
      {.motion = name,
       .robot_file = robot_file,
       .plant_file = options.plant.empty() ? robot_file : options.plant,
       .daemon = config::LoadDaemon(ConfigFile("tendrild.yaml")),
       .capstan_compensation = options.compensation == "on",
       .seed = options.seed,
       .folder = folder},
      [&](const experiment::DemoProgress& p) { bar.Show(p); }, StoppedBy);
}

void RunDemo(const DemoOptions& options) {
  if (options.out.empty()) throw UsageError("--out needs a folder, for example --out tendril-demo");
  std::vector<std::string> names;
  if (options.trajectory == "all") {
    names = {"circle", "planar"};
    // Of one robot for both, only what it can do.
    if (!options.robot.empty()) {
      const RobotParameters robot = sim::LoadRobot(options.robot);
      if (const std::string held = model::HeldDirections(robot.body); !held.empty()) {
        fmt::print(stderr, "tendril demo: no circle, because of robot '{}' {}: planar only\n", robot.name,
                   held);
        names = {"planar"};
      }
    }
  } else {
    names = {options.trajectory};
  }
  CatchStopSignals();
  const fs::path out(options.out);
  std::vector<fs::path> folders;
  for (const auto& name : names) folders.push_back(MakeOutputFolder(out / name));  // before any work is done
  std::vector<ordered_json> summaries;
  for (std::size_t i = 0; i < names.size(); ++i)
    summaries.push_back(RunMotion(names[i], options, folders[i]));
  if (options.plots) RunPlotScript("plot_demo.py", folders, "the plots");
  fmt::print("{}", experiment::DemoTable(summaries));
  fmt::print("\n  compensation of pulley friction: {}\n",
             summaries.front()["compensation"].get<bool>() ? "on" : "off");
  for (const auto& s : summaries) {
    fmt::print("  {}\n",
               (fs::absolute(out) / s["trajectory"].get<std::string>()).lexically_normal().string());
  }
  fmt::print("    summary.json, samples.csv, run.lcmlog and the plots (*.png, *.svg, *.pdf)\n");
}

}  // namespace

void AddDemoCommand(CLI::App& app) {
  auto options = std::make_shared<DemoOptions>();
  CLI::App* command = app.add_subcommand(
      "demo",
      "Controller, CANopen, drive emulators and plant in one process: the paper's circle and planar bend");
  command->add_option(
      "--robot", options->robot,
      "the controller's robot file (default: rig_60mm for the circle, rig_90mm for the planar bend)");
  command->add_option("--plant", options->plant, "the plant's robot file (default: the controller's)");
  command->add_option("--trajectory", options->trajectory, "what to follow")
      ->check(CLI::IsMember({"circle", "planar", "all"}))
      ->capture_default_str();
  command->add_option("--compensation", options->compensation, "of the pulleys' friction")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  command->add_option("--out", options->out, "folder for DIR/circle and DIR/planar")->capture_default_str();
  command->add_option("--seed", options->seed, "of the sensor noise")->check(Seed())->capture_default_str();
  command->add_flag("!--no-plots", options->plots, "leave out the plots");
  command->callback([options] { RunDemo(*options); });
}

}  // namespace tendril::tools
