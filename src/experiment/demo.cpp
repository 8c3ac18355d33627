#include "tendril/experiment/demo.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "demo_samples.h"
#include "tendril/core/version.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/motion/motion.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct Statistic {
  std::uint64_t count = 0;
  double sum = 0, sum2 = 0, largest = -std::numeric_limits<double>::infinity();
  void Add(double x) {
    ++count;
    sum += x;
    sum2 += x * x;
    largest = std::max(largest, x);
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

struct Timing {
  TimeNs start_ns;         // of the motion
  double bus_s;            // how long the bus was watched,
  std::uint64_t bus_bits;  // and what it carried
  double wall_s;
};

ordered_json Summary(const DemoRun& demo, const motion::Motion& motion, const ClosedLoop& loop,
                     const Figures& figures, const Timing& timing) {
  const int tendons = static_cast<int>(figures.base_error.size());
  const CycleRecord& last = loop.record();
  const double judged_from_s = ToSeconds(timing.start_ns + loop.cycle_ns()) + motion.judged_from_s();
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
  return {{"trajectory", demo.motion},
          {"description", motion.description()},
          {"robot", demo.robot_file},
          {"plant", demo.plant_file},
          {"compensation", demo.capstan_compensation},
          {"seed", demo.seed},
          {"version", Version()},
          {"git_revision", GitRevision()},
          {"simulated_s", loop.now_s()},
          {"wall_s", timing.wall_s},
          {"real_time_factor", loop.now_s() / timing.wall_s},
          {"cycle_s", ToSeconds(loop.cycle_ns())},
          {"cycles", last.input.cycle + 1},
          {"deadline_misses", last.timing.deadline_misses},
          {"feedback_missing", last.output.feedback_missing},
          {"commands_accepted", last.output.commands_accepted},
          {"commands_refused", last.output.commands_refused},
          {"bus_load", static_cast<double>(timing.bus_bits) / (timing.bus_s * loop.daemon().bus.bitrate_bps)},
          {"bus_load_budget", canopen::ComputeBusBudget(loop.daemon().bus, loop.drive_setups()).load},
          {"judged_from_s", judged_from_s},
          {"judged_until_s", judged_from_s + motion.judged_until_s() - motion.judged_from_s()},
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
}

ClosedLoopOptions LoopOf(const DemoRun& demo) {
  ClosedLoopOptions options{.controller_robot = sim::LoadRobot(demo.robot_file),
                            .plant_robot = sim::LoadRobot(demo.plant_file),
                            .daemon = demo.daemon,
                            .plant = {.seed = demo.seed},
                            .log_path = (demo.folder / "run.lcmlog").string()};
  options.daemon.controller.capstan_compensation = demo.capstan_compensation;
  options.daemon.robot_file = demo.robot_file;
  options.daemon.lcm.state_every_cycles = 10;
  return options;
}

}  // namespace

ordered_json RunDemo(const DemoRun& demo, const std::function<void(const DemoProgress&)>& progress,
                     const std::function<std::string()>& stopped_by) {
  const ClosedLoopOptions options = LoopOf(demo);
  const RobotParameters& robot = options.controller_robot;
  const auto motion = motion::MakeMotion(demo.motion, robot);
  const int tendons = robot.body.tendons();

  RemoveOldResults(demo.folder);
  ClosedLoop loop(options);
  SampleWriter samples(demo.folder / "samples.csv", static_cast<int>(robot.body.sections.size()), tendons,
                       loop.plant().body().units());
  Figures figures(tendons);
  const double wall_start = WallSeconds();
  const std::uint64_t sample_every = CyclesOf(loop, kSamplePeriod_s);

  // Every step of the run passes here: samples, Ctrl-C, faults.
  const auto observe = [&](const CycleRecord& r, const Eigen::Vector3d& target_W_m) {
    if (r.input.cycle % sample_every == 0) samples.Write(loop.now_s(), r, loop.plant(), target_W_m);
    if (const std::string by = stopped_by(); !by.empty()) {
      throw std::runtime_error(fmt::format("stopped by {} at t = {:.2f} s of {}; what was recorded is in {}",
                                           by, loop.now_s(), demo.motion, demo.folder.string()));
    }
    if (r.output.mode == Mode::kFault) {
      throw std::runtime_error(fmt::format("{} at t = {:.3f} s of {} ({})", StatusText(r.output.status),
                                           loop.now_s(), demo.motion, StatusRemedy(r.output.status)));
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
      figures.Add(r, loop.plant(), wanted, robot.limits.min_tension_N);
    }
    progress({ToSeconds(loop.now_ns() - start_ns) / motion->duration_s(), loop.now_s(),
              WallSeconds() - wall_start, (loop.plant().TipPose().p_WA - wanted).norm()});
  });
  Timing timing{start_ns, ToSeconds(loop.now_ns() - start_ns), loop.bus().bits - bus_before.bits, 0};
  loop.DisarmAndWait();
  timing.wall_s = WallSeconds() - wall_start;
  progress({1, loop.now_s(), timing.wall_s, figures.tip_error.rms(), true});

  const ordered_json summary = Summary(demo, *motion, loop, figures, timing);
  std::ofstream out(demo.folder / "summary.json");
  out << summary.dump(2) << '\n';
  if (!out.flush()) throw std::runtime_error("cannot write " + (demo.folder / "summary.json").string());
  return summary;
}

std::string DemoTable(const std::vector<ordered_json>& summaries) {
  std::string table;
  const auto row = [&](const char* what, const char* unit, auto value) {
    table += fmt::format("  {:<52}", fmt::format("{} [{}]", what, unit));
    for (const auto& s : summaries) table += fmt::format("{:>12}", value(s));
    table += "\n";
  };
  const auto number = [](const char* key, double scale, int digits) {
    return [=](const ordered_json& s) {
      return fmt::format("{:.{}f}", s[key].template get<double>() * scale, digits);
    };
  };
  table += fmt::format("\n  {:<52}", "");
  for (const auto& s : summaries) table += fmt::format("{:>12}", s["trajectory"].get<std::string>());
  table += "\n";
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
      table += fmt::format("  {}: {} in {} cycles\n", s["trajectory"].get<std::string>(),
                           status["text"].get<std::string>(), status["cycles"].get<std::uint64_t>());
    }
  }
  return table;
}

}  // namespace tendril::experiment
