// `tendril demo`: the paper's robot follows a commanded circle and a planar bend, everything in one process
// and simulated time; leaves a log, a summary, samples and plots.
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>
#include <vector>

#include "commands.h"
#include "output.h"
#include "paths.h"
#include "seed_option.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/model/held_directions.h"
#include "tendril/motion/motion.h"
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

volatile std::sig_atomic_t interrupted = 0;

struct Interrupted : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// ---- accumulated figures ----------------------------------------------------------------------------------

struct Statistic {
  std::uint64_t count = 0;
  double sum = 0, sum2 = 0, largest = -std::numeric_limits<double>::infinity(), largest_size = 0;
  void Add(double x) {
    ++count;
    sum += x;
    sum2 += x * x;
    largest = std::max(largest, x);
    largest_size = std::max(largest_size, std::abs(x));
  }
  double mean() const { return count ? sum / static_cast<double>(count) : 0; }
  double rms() const { return count ? std::sqrt(sum2 / static_cast<double>(count)) : 0; }
  double max() const { return count ? largest : 0; }
};

// Figures of the judged part of a motion.
struct Figures {
  explicit Figures(int tendons)
      : desired(tendons), motor(tendons), base(tendons), measured(tendons), base_error(tendons) {}

  void Add(const CycleRecord& record, const sim::Plant& plant, const Eigen::Vector3d& wanted_tip_W_m,
           double min_tension_N) {
    const CycleOutput& o = record.output;
    if (o.status != Status::kOk) ++cycles_by_status[o.status];
    tip_error.Add((plant.TipPose().p_WA - wanted_tip_W_m).norm());
    estimate_error.Add((plant.TipPose().p_WA - o.tip_estimate_W_m).norm());
    for (int j = 0; j < static_cast<int>(desired.size()); ++j) {
      const auto i = static_cast<std::size_t>(j);
      const sim::TendonState& t = plant.tendon()[i];
      const double loss_N = t.tension_motor_N - t.tension_base_N;
      desired[i].Add(o.tension_desired_base_N[j]);
      motor[i].Add(t.tension_motor_N);
      base[i].Add(t.tension_base_N);
      measured[i].Add(o.tension_measured_N[j]);
      base_error[i].Add(t.tension_base_N - o.tension_desired_base_N[j]);
      all_base_error.Add(t.tension_base_N - o.tension_desired_base_N[j]);
      // What the pulleys took less what the controller added for them: the base tension error they are to
      // blame for.
      capstan_error.Add(loss_N - (o.tension_desired_motor_N[j] - o.tension_desired_base_N[j]));
      if (o.tension_desired_base_N[j] > min_tension_N + 0.05) friction_loss.Add(loss_N);
    }
  }

  std::map<Status, std::uint64_t> cycles_by_status;
  Statistic tip_error, estimate_error, friction_loss, capstan_error, all_base_error;
  std::vector<Statistic> desired, motor, base, measured, base_error;
};

// ---- samples for plots and other programs -----------------------------------------------------------------

class SampleWriter {
 public:
  /// `units` of the plant's body: the positions of their disks show the whole robot.
  SampleWriter(const fs::path& path, int sections, int tendons, int units)
      : path_(path), sections_(sections), tendons_(tendons), disks_(static_cast<std::size_t>(units)) {
    file_.reset(std::fopen(path.c_str(), "w"));
    if (!file_)
      throw std::runtime_error(fmt::format("cannot write {}: {}", path.string(), std::strerror(errno)));
    std::string header =
        "t_s,mode,tip_target_x_m,tip_target_y_m,tip_target_z_m,tip_true_x_m,tip_true_y_m,tip_true_z_m,"
        "tip_estimate_x_m,tip_estimate_y_m,tip_estimate_z_m";
    for (int k = 1; k <= sections; ++k) {
      const std::string suffix = sections > 1 ? fmt::format("_{}", k) : "";
      for (const char* what : {"desired", "true", "estimate"}) {
        header += fmt::format(",us_{0}_rad{1},vs_{0}_rad{1}", what, suffix);
      }
    }
    for (int j = 1; j <= tendons; ++j) {
      for (const char* what :
           {"displacement_desired_m", "displacement_m", "displacement_true_m", "tension_desired_base_N",
            "tension_desired_motor_N", "tension_motor_true_N", "tension_base_true_N", "tension_measured_N",
            "torque_target_Nm", "torque_actual_Nm"}) {
        header += fmt::format(",{}_{}", what, j);
      }
    }
    for (std::size_t i = 1; i <= disks_.size(); ++i)
      header += fmt::format(",disk_x_m_{0},disk_y_m_{0},disk_z_m_{0}", i);
    fmt::print(file_.get(), "{}\n", header);
  }

  void Write(double t_s, const CycleRecord& record, const sim::Plant& plant,
             const Eigen::Vector3d& target_W_m) {
    try {
      WriteRow(t_s, record, plant, target_W_m);
    } catch (const std::system_error& e) {
      throw std::runtime_error(
          fmt::format("cannot write {}: {}; free some space or choose another folder with --out",
                      path_.string(), e.code().message()));
    }
  }

 private:
  void WriteRow(double t_s, const CycleRecord& record, const sim::Plant& plant,
                const Eigen::Vector3d& target_W_m) {
    const CycleOutput& o = record.output;
    const Eigen::Vector3d tip = plant.TipPose().p_WA;
    fmt::print(file_.get(), "{:.3f},{}", t_s, static_cast<int>(o.mode));
    for (const auto& p : {target_W_m, tip, o.tip_estimate_W_m}) {
      if (p.allFinite()) {
        fmt::print(file_.get(), ",{:.7g},{:.7g},{:.7g}", p.x(), p.y(), p.z());
      } else {
        fmt::print(file_.get(), ",,,");
      }
    }
    BendingVector bend(2 * sections_);
    plant.body().SumBending(plant.q(), bend);
    for (int k = 0; k < sections_; ++k) {
      for (const BendingVector& b : {o.reference.position_rad, bend, o.bending_estimate_rad}) {
        fmt::print(file_.get(), ",{:.7g},{:.7g}", b[2 * k], b[2 * k + 1]);
      }
    }
    for (int j = 0; j < tendons_; ++j) {
      const sim::TendonState& t = plant.tendon()[static_cast<std::size_t>(j)];
      fmt::print(file_.get(), ",{:.7g},{:.7g},{:.7g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}",
                 o.displacement_desired_m[j], o.displacement_m[j], t.body_shortening_m,
                 o.tension_desired_base_N[j], o.tension_desired_motor_N[j], t.tension_motor_N,
                 t.tension_base_N, o.tension_measured_N[j], o.torque_desired_Nm[j], o.torque_measured_Nm[j]);
    }
    plant.body().Poses(plant.q(), disks_);
    for (const model::Pose& disk : disks_)
      fmt::print(file_.get(), ",{:.6g},{:.6g},{:.6g}", disk.p_WA.x(), disk.p_WA.y(), disk.p_WA.z());
    fmt::print(file_.get(), "\n");
  }

  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  fs::path path_;
  int sections_, tendons_;
  std::vector<model::Pose> disks_;
  std::unique_ptr<std::FILE, Close> file_;
};

// ---- one motion -------------------------------------------------------------------------------------------

class Progress {
 public:
  explicit Progress(std::string name) : name_(std::move(name)), terminal_(isatty(STDERR_FILENO)) {}
  void Show(double share, double simulated_s, double wall_s, double tip_error_m, bool last = false) {
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

double WallSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

constexpr double kSamplePeriod_s = 0.01;

ordered_json Describe(const std::vector<Statistic>& of, const char* what, ordered_json tensions) {
  for (std::size_t j = 0; j < of.size(); ++j) {
    tensions[j][std::string(what) + "_mean_N"] = of[j].mean();
    tensions[j][std::string(what) + "_max_N"] = of[j].max();
  }
  return tensions;
}

// What an earlier run left must not stand beside the files of one that was broken off.
void RemoveOldResults(const fs::path& folder) {
  std::error_code ignored;
  fs::remove(folder / "summary.json", ignored);
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    const fs::path kind = entry.path().extension();
    if (kind == ".png" || kind == ".svg" || kind == ".pdf") fs::remove(entry.path(), ignored);
  }
}

// Cycles of the judged part in which a limit acted or something was wrong, by status.
ordered_json Describe(const std::map<Status, std::uint64_t>& cycles_by_status) {
  ordered_json list = ordered_json::array();
  for (const auto& [status, cycles] : cycles_by_status) {
    list.push_back({{"status", static_cast<int>(status)}, {"text", StatusText(status)}, {"cycles", cycles}});
  }
  return list;
}

ordered_json RunMotion(const std::string& name, const DemoOptions& options, const fs::path& folder) {
  const std::string default_file =
      ConfigFile(name == "circle" ? "robots/rig_60mm.yaml" : "robots/rig_90mm.yaml");
  const std::string robot_file = options.robot.empty() ? default_file : options.robot;
  const std::string plant_file =
      !options.plant.empty() ? options.plant : (options.robot.empty() ? default_file : options.robot);

  ClosedLoopOptions loop_options{.controller_robot = sim::LoadRobot(robot_file),
                                 .plant_robot = sim::LoadRobot(plant_file),
                                 .daemon = config::LoadDaemon(ConfigFile("tendrild.yaml")),
                                 .plant = {.seed = options.seed},
                                 .log_path = (folder / "run.lcmlog").string()};
  loop_options.daemon.controller.capstan_compensation = options.compensation == "on";
  loop_options.daemon.robot_file = robot_file;
  loop_options.daemon.lcm.state_every_cycles = 10;
  const auto motion = MakeMotion(name, loop_options.controller_robot);
  const int tendons = loop_options.controller_robot.body.tendons();
  const double min_tension_N = loop_options.controller_robot.limits.min_tension_N;

  RemoveOldResults(folder);
  ClosedLoop loop(loop_options);
  SampleWriter samples(folder / "samples.csv",
                       static_cast<int>(loop_options.controller_robot.body.sections.size()), tendons,
                       loop.plant().body().units());
  Figures figures(tendons);
  Progress progress(name);
  const double wall_start = WallSeconds();
  const std::uint64_t sample_every = CyclesOf(loop, kSamplePeriod_s);

  // Every step of the run passes here: samples, Ctrl-C, faults.
  const auto observe = [&](const CycleRecord& r, const Eigen::Vector3d& target_W_m) {
    if (r.input.cycle % sample_every == 0) samples.Write(loop.now_s(), r, loop.plant(), target_W_m);
    if (interrupted) {
      throw Interrupted(fmt::format("stopped by {} at t = {:.2f} s of {}; what was recorded is in {}",
                                    interrupted == SIGTERM ? "SIGTERM" : "Ctrl-C", loop.now_s(), name,
                                    folder.string()));
    }
    if (r.output.mode == Mode::kFault) {
      throw std::runtime_error(fmt::format("{} at t = {:.3f} s of {} ({})", StatusText(r.output.status),
                                           loop.now_s(), name, StatusRemedy(r.output.status)));
    }
  };

  loop.ArmAndPretension();

  ApproachStart(loop, *motion, [&](const CycleRecord& r, double) { observe(r, motion->TipAt(0)); });

  const TimeNs start_ns = loop.now_ns();
  const can::CanCounters bus_before = loop.bus();
  StreamMotion(loop, *motion, [&](const CycleRecord& r, double target_s) {
    const Eigen::Vector3d wanted = motion->TipAt(target_s);
    observe(r, wanted);
    if (target_s >= motion->judged_from_s() && target_s <= motion->judged_until_s()) {
      figures.Add(r, loop.plant(), wanted, min_tension_N);
    }
    progress.Show(ToSeconds(loop.now_ns() - start_ns) / motion->duration_s(), loop.now_s(),
                  WallSeconds() - wall_start, (loop.plant().TipPose().p_WA - wanted).norm());
  });
  const can::CanCounters bus_after = loop.bus();
  const double bus_s = ToSeconds(loop.now_ns() - start_ns);
  loop.DisarmAndWait();
  const double wall_s = WallSeconds() - wall_start;
  progress.Show(1, loop.now_s(), wall_s, figures.tip_error.rms(), true);

  const CycleRecord& last = loop.record();
  const double judged_from_s = ToSeconds(start_ns + loop.cycle_ns()) + motion->judged_from_s();
  ordered_json tensions = ordered_json::array();
  for (int j = 0; j < tendons; ++j) tensions.push_back({{"tendon", j + 1}});
  tensions = Describe(figures.desired, "desired_base", tensions);
  tensions = Describe(figures.motor, "motor", tensions);
  tensions = Describe(figures.base, "base", tensions);
  tensions = Describe(figures.measured, "measured", tensions);
  for (int j = 0; j < tendons; ++j) {
    tensions[static_cast<std::size_t>(j)]["base_error_rms_N"] =
        figures.base_error[static_cast<std::size_t>(j)].rms();
  }
  ordered_json summary = {
      {"trajectory", name},
      {"description", motion->description()},
      {"robot", robot_file},
      {"plant", plant_file},
      {"compensation", options.compensation == "on"},
      {"seed", options.seed},
      {"version", Version()},
      {"git_revision", GitRevision()},
      {"simulated_s", loop.now_s()},
      {"wall_s", wall_s},
      {"real_time_factor", loop.now_s() / wall_s},
      {"cycle_s", ToSeconds(loop.cycle_ns())},
      {"cycles", last.input.cycle + 1},
      {"deadline_misses", last.timing.deadline_misses},
      {"feedback_missing", last.output.feedback_missing},
      {"commands_accepted", last.output.commands_accepted},
      {"commands_refused", last.output.commands_refused},
      {"bus_load",
       static_cast<double>(bus_after.bits - bus_before.bits) / (bus_s * loop.daemon().bus.bitrate_bps)},
      {"bus_load_budget", canopen::ComputeBusBudget(loop.daemon().bus).load},
      {"judged_from_s", judged_from_s},
      {"judged_until_s", judged_from_s + motion->judged_until_s() - motion->judged_from_s()},
      {"tip_rms_error_m", figures.tip_error.rms()},
      {"tip_max_error_m", figures.tip_error.max()},
      {"tip_estimate_rms_error_m", figures.estimate_error.rms()},
      {"friction_loss_mean_N", figures.friction_loss.mean()},
      {"friction_loss_max_N", figures.friction_loss.max()},
      {"capstan_error_rms_N", figures.capstan_error.rms()},
      {"base_tension_error_rms_N", figures.all_base_error.rms()},
      {"tensions", tensions},
      {"statuses", Describe(figures.cycles_by_status)},
      {"log", "run.lcmlog"},
      {"log_events", loop.log_events()}};
  std::ofstream out(folder / "summary.json");
  out << summary.dump(2) << '\n';
  if (!out.flush()) throw std::runtime_error("cannot write " + (folder / "summary.json").string());
  return summary;
}

// ---- the command ------------------------------------------------------------------------------------------

void PrintTable(const std::vector<ordered_json>& summaries, const fs::path& out) {
  const auto row = [&](const char* what, const char* unit, auto value) {
    fmt::print("  {:<52}", fmt::format("{} [{}]", what, unit));
    for (const auto& s : summaries) fmt::print("{:>12}", value(s));
    fmt::print("\n");
  };
  const auto number = [](const char* key, double scale, int digits) {
    return [=](const ordered_json& s) {
      return fmt::format("{:.{}f}", s[key].template get<double>() * scale, digits);
    };
  };
  fmt::print("\n  {:<52}", "");
  for (const auto& s : summaries) fmt::print("{:>12}", s["trajectory"].get<std::string>());
  fmt::print("\n");
  row("tip error, rms", "mm", number("tip_rms_error_m", 1e3, 3));
  row("tip error, largest", "mm", number("tip_max_error_m", 1e3, 3));
  row("friction loss in the pulleys, mean", "N", number("friction_loss_mean_N", 1, 3));
  row("friction loss in the pulleys, largest", "N", number("friction_loss_max_N", 1, 3));
  row("base tension error left by the pulleys, rms", "N", number("capstan_error_rms_N", 1, 3));
  row("base tension error in total, rms", "N", number("base_tension_error_rms_N", 1, 3));
  row("bus load", "%", number("bus_load", 100, 1));
  row("cycles", "1",
      [](const ordered_json& s) { return fmt::format("{}", s["cycles"].get<std::uint64_t>()); });
  row("deadline misses", "1",
      [](const ordered_json& s) { return fmt::format("{}", s["deadline_misses"].get<std::uint64_t>()); });
  row("speed", "x real time", number("real_time_factor", 1, 0));
  for (const auto& s : summaries) {
    for (const auto& status : s["statuses"]) {
      fmt::print("  {}: {} in {} cycles\n", s["trajectory"].get<std::string>(),
                 status["text"].get<std::string>(), status["cycles"].get<std::uint64_t>());
    }
  }
  fmt::print("\n  compensation of pulley friction: {}\n",
             summaries.front()["compensation"].get<bool>() ? "on" : "off");
  for (const auto& s : summaries) {
    fmt::print("  {}\n",
               (fs::absolute(out) / s["trajectory"].get<std::string>()).lexically_normal().string());
  }
  fmt::print("    summary.json, samples.csv, run.lcmlog and the plots (*.png, *.svg, *.pdf)\n");
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
  std::signal(SIGINT, [](int signal) { interrupted = signal; });
  std::signal(SIGTERM, [](int signal) { interrupted = signal; });
  const fs::path out(options.out);
  std::vector<fs::path> folders;
  for (const auto& name : names) folders.push_back(MakeOutputFolder(out / name));  // before any work is done
  std::vector<ordered_json> summaries;
  for (std::size_t i = 0; i < names.size(); ++i)
    summaries.push_back(RunMotion(names[i], options, folders[i]));
  if (options.plots) RunPlotScript("plot_demo.py", folders, "the plots");
  PrintTable(summaries, out);
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
