// tendril gap import: anybody's tables as a folder of runs, or as a log like the daemon's. Knows the command
// line and the daemon's units; what a map may say is the gap room's business.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <set>

#include "commands.h"
#include "counted.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/daemon/wiring.h"
#include "tendril/gap/cuts.h"
#include "tendril/gap/health.h"
#include "tendril/gap/import.h"
#include "tendril/gap/set_folder.h"
#include "tendril/io/gateway.h"
#include "tendril/io/log.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct ImportOptions {
  std::string robot, map, out, log;
  std::vector<std::string> tables;
  bool overwrite = false;
};

/// Writes runs as the cycles that a daemon would have logged; what its units cannot hold is counted.
class CycleLog {
 public:
  CycleLog(const RobotParameters& robot, const std::string& path)
      : robot_(robot), gateway_(Lcm(), daemon::ShapeOf(robot), clock_), log_(gateway_, path, clock_) {
    gateway_.PublishRun({.robot_yaml = config::ToYaml(robot),
                         .daemon_yaml = {},
                         .version = std::string(Version()),
                         .git_revision = std::string(GitRevision()),
                         .start_utime = 0});
  }

  void Write(const gap::Run& run) {
    const Eigen::VectorXd& t = run.time_s;
    const double step_s = std::max((t[t.size() - 1] - t[0]) / static_cast<double>(t.size() - 1), 1e-9);
    // Drives on but not in motion between runs: each begins anew.
    Publish(run, 0, Mode::kConfigured, clock_.Now());
    const TimeNs start_ns = clock_.Now();
    std::uint64_t cycle = cycle_;
    for (Eigen::Index i = 0; i < t.size(); ++i) {
      const double at_s = t[i] - t[0];
      cycle_ = std::max(cycle_ + (i > 0), cycle + static_cast<std::uint64_t>(std::llround(at_s / step_s)));
      Publish(run, i, Mode::kRunning, start_ns + std::llround(at_s * 1e9));
    }
    ++cycle_;
    clock_.Advance(std::max<TimeNs>(std::llround(step_s * 1e9), 1));
  }

  /// Ends the log: what was out of the units' range, and whether everything is on the disk.
  std::string Finish() {
    if (!log_.error().empty()) throw std::runtime_error(log_.error());
    return clipped_ == 0 ? ""
                         : fmt::format(
                               "{} values exceed the range of the drives' units and were clipped; check the "
                               "robot file's rated torque and load cell",
                               clipped_);
  }
  std::uint64_t events() const { return log_.events(); }

 private:
  static LcmParameters Lcm() {
    LcmParameters lcm;
    lcm.url = "memq://";
    lcm.channel_prefix = "TENDRIL";
    lcm.cycle_every_cycles = 1;
    return lcm;
  }

  template <class Integer>
  Integer Whole(double value) {
    if (!std::isfinite(value)) return 0;
    const double least = std::numeric_limits<Integer>::min(), most = std::numeric_limits<Integer>::max();
    if (value < least || value > most) ++clipped_;
    return static_cast<Integer>(std::llround(std::clamp(value, least, most)));
  }

  void Publish(const gap::Run& run, Eigen::Index row, Mode mode, TimeNs time_ns) {
    clock_.Advance(std::max<TimeNs>(time_ns - clock_.Now(), 0));
    CycleRecord record;
    record.input.cycle = cycle_;
    record.input.time_ns = time_ns;
    record.input.drives = robot_.body.tendons();
    record.output.mode = mode;
    record.output.displacement_m = TendonVector::Zero(record.input.drives);
    for (int j = 0; j < record.input.drives; ++j) FillDrive(run, row, j, mode, record);
    if (mode == Mode::kRunning) FillTracker(run, row, time_ns, record.input.tracker);
    gateway_.PublishCycle(record);
    gateway_.Handle(0);  // what goes round in the process must not pile up
    if (mode != Mode::kRunning) ++cycle_;
  }

  void FillDrive(const gap::Run& run, Eigen::Index row, int j, Mode mode, CycleRecord& record) {
    const auto d = static_cast<std::size_t>(j);
    const auto& tendon = robot_.actuation->tendons[d];
    const auto value = [&](const Eigen::MatrixXd& m, Eigen::Index i) { return m.cols() > j ? m(i, j) : 0.0; };
    DriveFeedback& drive = record.input.drive[d];
    drive.state = mode == Mode::kRunning ? DriveState::kEnabled : DriveState::kReady;
    const double position = value(run.motor_position_rad, row), torque = value(run.torque_actual_Nm, row),
                 tension = value(run.tension_N, row);
    drive.age_cycles = std::isfinite(position + torque + tension) ? 0 : 1;
    const double per_turn = tendon.drive.encoder_counts_per_turn / (2 * std::numbers::pi);
    drive.position_counts = Whole<std::int32_t>(position * per_turn);
    // By which a reader of the log knows where positions count from.
    if (std::isfinite(position)) record.output.displacement_m[j] = position * tendon.SpoolTravelPerMotorRad();
    drive.torque_permille = Whole<std::int16_t>(1e3 * torque / tendon.drive.rated_torque_Nm);
    drive.analog_mV =
        Whole<std::int16_t>(1e3 * tendon.load_cell.gain_VpN * (tension + tendon.load_cell.offset_N));
    record.output.torque_target_permille[d] =
        Whole<std::int16_t>(1e3 * value(run.torque_target_Nm, row) / tendon.drive.rated_torque_Nm);
  }

  static void FillTracker(const gap::Run& run, Eigen::Index row, TimeNs time_ns, TrackerSample& sample) {
    if (run.tip_m.cols() == 0 || !run.tip_m.row(row).allFinite()) return;
    sample.valid = true;
    sample.time_ns = time_ns;
    sample.tip_W_m = run.tip_m.row(row).transpose();
    if (run.tip_quaternion.cols() == 0 || !run.tip_quaternion.row(row).allFinite()) return;
    sample.orientation_WT = {run.tip_quaternion(row, 0), run.tip_quaternion(row, 1),
                             run.tip_quaternion(row, 2), run.tip_quaternion(row, 3)};
  }

  const RobotParameters& robot_;
  SimulatedClock clock_;
  io::Gateway gateway_;
  io::LogWriter log_;
  std::uint64_t cycle_ = 0, clipped_ = 0;
};

void WriteLog(const gap::DataSet& set, const std::string& path) {
  std::set<std::string> lacking;
  for (const gap::Run& run : set.runs) {
    if (run.motor_position_rad.cols() == 0) lacking.insert("motor_position");
    if (run.torque_actual_Nm.cols() == 0) lacking.insert("torque_actual");
    if (run.torque_target_Nm.cols() == 0) lacking.insert("torque_target");
    if (run.tension_N.cols() == 0) lacking.insert("tension");
    if (run.tip_quaternion.cols() == 0 && run.tip_m.cols() > 0) lacking.insert("orientation");
  }
  const bool elsewhere = std::any_of(set.runs.begin(), set.runs.end(), [](const gap::Run& run) {
    return run.motor_position_rad.cols() > 0 && run.motor_position_rad.row(0).cwiseAbs().maxCoeff() > 0.01;
  });
  if (elsewhere) {
    fmt::print(stderr,
               "tendril: {}: in a log the motors' zero is that of the initial rest of a run; a folder "
               "(--out) keeps positions that begin elsewhere\n",
               path);
  }
  CycleLog log(set.robot, path);
  for (const gap::Run& run : set.runs) log.Write(run);
  const std::string cut = log.Finish();
  fmt::print("{}: {}, {}\n", path, Counted(set.runs.size(), "run"), Counted(log.events(), "event"));
  std::string names;
  for (const std::string& name : lacking) names += (names.empty() ? "" : ", ") + name;
  if (!names.empty()) {
    fmt::print(stderr,
               "tendril: {}: a log cannot mark a channel as not measured; it contains zeros for {}; a folder "
               "(--out) can\n",
               path, names);
  }
  if (!cut.empty()) fmt::print(stderr, "tendril: {}: {}\n", path, cut);
}

/// The same of several runs is one line, and there are no more lines than somebody reads; what is worst comes
/// first.
void PrintFindings(const std::vector<gap::HealthFinding>& findings) {
  using Severity = gap::HealthFinding::Severity;
  constexpr std::size_t kMost = 24;
  struct Group {
    const gap::HealthFinding* first;
    std::size_t others;
  };
  std::vector<Group> groups;
  std::map<std::string, std::size_t> known;
  for (const gap::HealthFinding& f : findings) {
    if (f.severity == Severity::kInfo && f.channel != "file") continue;
    std::string kind = fmt::format("{} {} ", static_cast<int>(f.severity), f.channel);
    for (const char c : f.text) {
      if (!std::isdigit(static_cast<unsigned char>(c))) kind += c;
    }
    const auto [at, is_first] = known.emplace(kind, groups.size());
    if (is_first) {
      groups.push_back({&f, 0});
    } else {
      ++groups[at->second].others;
    }
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Group& a, const Group& b) { return a.first->severity > b.first->severity; });
  for (std::size_t i = 0; i < std::min(groups.size(), kMost); ++i) {
    const auto& [f, others] = groups[i];
    fmt::print(stderr, "tendril: {}{}{}{}: {}\n", f->severity == Severity::kError ? "wrong data: " : "data: ",
               f->run.empty() ? "" : f->run + ": ", f->channel,
               others > 0 ? fmt::format(" (and {} more like it)", others) : "", f->text);
  }
  if (groups.size() > kMost)
    fmt::print(stderr, "tendril: data: and {} more; the report of `tendril gap diagnose` lists all\n",
               groups.size() - kMost);
}

/// What would lose a file is found before anything is read. Returns where the set goes, if anywhere.
std::optional<gap::SetFolder> CheckPlaces(const ImportOptions& options) {
  std::vector<std::string> inputs{options.robot, options.map};
  inputs.insert(inputs.end(), options.tables.begin(), options.tables.end());
  if (!options.log.empty()) {
    gap::RefuseToReplace(options.log, "--log", inputs);
    gap::CheckWritable(options.log);
  }
  std::error_code ignored;
  for (const std::string& table : options.tables) {
    if (options.out.empty() || !fs::equivalent(fs::absolute(table).parent_path(), options.out, ignored))
      continue;
    throw UsageError(fmt::format(
        "--out {} is the folder of {}, which a run with that name would replace; give another --out",
        options.out, table));
  }
  if (options.out.empty()) return {};
  return gap::SetFolder(options.out, options.overwrite, inputs);
}

void RunImport(const ImportOptions& options) {
  if (options.out.empty() && options.log.empty()) {
    throw UsageError("gap import: no destination; give a folder by --out or a log by --log");
  }
  const std::optional<gap::SetFolder> folder = CheckPlaces(options);
  const RobotParameters robot = sim::LoadRobot(options.robot);
  if (!options.log.empty() && !robot.actuation) {
    throw std::runtime_error(
        "a log needs a robot file with actuation (drives, encoders, load cells); use --out");
  }
  const gap::DataSet set = gap::ImportTables(options.map, options.tables, robot);
  if (folder) {
    folder->Write(set);
    fmt::print("{}: {}\n", fs::absolute(options.out).lexically_normal().string(),
               Counted(set.runs.size(), "run"));
  }
  if (!options.log.empty()) WriteLog(set, options.log);

  std::set<std::string> families;
  std::size_t rows = 0, repeats = 0;
  for (const gap::Run& run : set.runs) {
    families.insert(run.family);
    rows += static_cast<std::size_t>(run.time_s.size());
    repeats += !run.repeat_of.empty();
  }
  fmt::print("{}, {}, {}\n", Counted(rows, "row"), Counted(families.size(), "family", "families"),
             Counted(repeats, "repetition"));
  PrintFindings(gap::CheckHealth(set));
  const std::vector<gap::CutOfSet> cuts = gap::CutsOf(set);
  fmt::print("{}\n", gap::CutsLine(cuts));
  std::fflush(stdout);
  const auto left_out = std::count_if(set.notes.begin(), set.notes.end(),
                                      [](const std::string& note) { return note.starts_with("left out: "); });
  // Somebody who calls this from a script would go on with less than was meant.
  if (left_out > 0) {
    throw std::runtime_error(fmt::format("{} of {} left out (above); the others were written",
                                         left_out == 1 ? "one" : std::to_string(left_out),
                                         Counted(options.tables.size(), "table")));
  }
  if (!gap::AnyCut(cuts)) {
    throw std::runtime_error(
        "these runs cannot be compared with a simulation; accepted: load cells or motor positions of every "
        "tendon, and a second channel to compare with (torque, tension, or the body's shape); map more "
        "columns");
  }
}

}  // namespace

void AddGapImportCommand(CLI::App& app) {
  auto options = std::make_shared<ImportOptions>();
  CLI::App* command = GapCommand(app).add_subcommand(
      "import",
      "Import tables of any robot and program as a folder of runs (or a log), through a column map");
  command->add_option("--robot", options->robot, "nominal robot file of the robot that was measured")
      ->required();
  command
      ->add_option("--map", options->map,
                   "YAML that describes the columns; config/import has examples with every key")
      ->required();
  command->add_option("tables", options->tables, "text files with one row per sample")->required();
  command->add_option("--out", options->out, "folder for robot.yaml, runs.yaml and one CSV per run");
  command->add_flag("--overwrite", options->overwrite, "replace the folder's data set");
  command->add_option("--log", options->log, "LCM log in the daemon's format, in its drives' units");
  command->callback([options] { RunImport(*options); });
}

}  // namespace tendril::tools
