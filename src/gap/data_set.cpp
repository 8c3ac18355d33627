// Sets of runs: folders with robot.yaml and runs.yaml, and any mixture of folders, tables and logs.
#include "tendril/gap/data_set.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>

#include "file_bytes.h"
#include "pair_motors.h"
#include "postures/states.h"
#include "runs_file.h"
#include "same_robot.h"
#include "sources.h"
#include "tendril/config/config.h"
#include "tendril/sim/effects.h"
#include "text.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> FilesIn(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator i(folder, error), end; !error && i != end; i.increment(error)) {
    std::error_code ignored;
    if (i->is_regular_file(ignored)) files.push_back(i->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

bool HasEnding(const fs::path& file, std::string_view ending) {
  return LowerCase(file.extension().string()) == ending;
}

std::vector<Run> ReadAny(const fs::path& file, const RobotOfSet& robot, std::vector<std::string>& notes) {
  if (IsLcmLog(file)) return ReadRunLog(file, robot, notes);
  std::vector<Run> one;
  one.push_back(ReadRunTable(file, robot.robot()));
  return one;
}

/// Everything in a run that depends on the declared place of its load cells.
void SettleCell(Run& run, std::optional<LoadCellPlace> declared) {
  if (declared) run.load_cell = *declared;
  if (run.tension_N.cols() == 0) {
    run.load_cell = LoadCellPlace::kNone;
  } else if (run.load_cell == LoadCellPlace::kNone) {
    if (declared) {
      run.notes.push_back("load_cell is none: its tension columns are not used");
      run.tension_N.resize(run.time_s.size(), 0);
    } else {
      run.notes.push_back(
          "the robot file has no load cell but the run has tensions: taken as measured on the motor's side; "
          "set load_cell in runs.yaml");
      run.load_cell = LoadCellPlace::kMotorSide;
    }
  }
}

/// The robot that the tables of a folder were recorded with; empty where no file names it, or none that can
/// be read.
std::optional<RobotParameters> RecordedWith(const fs::path& folder) {
  std::error_code ignored;
  if (!fs::exists(folder / "robot.yaml", ignored)) return std::nullopt;
  try {
    return sim::LoadRobot((folder / "robot.yaml").string());
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

/// Converts a table's newtons back to volts by the load cells of the recorded robot, then by those of the
/// given one. Returns the tendons whose cells differ.
std::set<int> TakeCells(Run& run, const RobotParameters& recorded, const RobotParameters& robot) {
  std::set<int> tendons;
  if (!recorded.actuation || !robot.actuation) return tendons;
  const std::size_t known = std::min(recorded.actuation->tendons.size(), robot.actuation->tendons.size());
  for (Eigen::Index j = 0; j < std::min(run.tension_N.cols(), static_cast<Eigen::Index>(known)); ++j) {
    const auto& was = recorded.actuation->tendons[static_cast<std::size_t>(j)].load_cell;
    const auto& is = robot.actuation->tendons[static_cast<std::size_t>(j)].load_cell;
    const bool both = was.place != LoadCellPlace::kNone && is.place != LoadCellPlace::kNone;
    if (!both || !(was.gain_VpN > 0) || !(is.gain_VpN > 0)) continue;
    if (was.gain_VpN == is.gain_VpN && was.offset_N == is.offset_N) continue;
    auto tension_N = run.tension_N.col(j).array();
    tension_N = (tension_N + was.offset_N) * (was.gain_VpN / is.gain_VpN) - is.offset_N;
    tendons.insert(static_cast<int>(j) + 1);
  }
  return tendons;
}

/// Tendons of the recorded robot without any column were not measured, but they exist.
void NameTendons(Run& run, int tendons) {
  for (Eigen::MatrixXd* m :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N}) {
    const Eigen::Index named = m->cols();
    if (named == 0 || named >= tendons) continue;
    m->conservativeResize(Eigen::NoChange, tendons);
    m->rightCols(tendons - named).setConstant(kNoReading);
  }
}

/// Reads the files of a list into the set; files that cannot be read become notes.
void AddRuns(DataSet& set, const RobotOfSet& robot, const fs::path& folder,
             const std::vector<ListedRun>& list) {
  const std::optional<RobotParameters> recorded = RecordedWith(folder);
  std::set<int> other_cells;
  for (const ListedRun& listed : list) {
    try {
      std::vector<Run> runs = ReadAny(listed.file, robot, set.notes);
      // A duplicated file would look like a robot that repeats without any noise. A few equal rows are
      // possible.
      constexpr Eigen::Index kMany = 20;
      const auto same = std::find_if(set.runs.begin(), set.runs.end(), [&](const Run& run) {
        return run.time_s.size() >= kMany && run.sha256 == runs.front().sha256;
      });
      if (same != set.runs.end()) {
        set.notes.push_back(
            fmt::format("left out: {}: identical to the file of run {}; a repetition is a separate recording",
                        listed.file.string(), Printable(same->name)));
        continue;
      }
      for (Run& run : runs) {
        if (recorded && !IsLcmLog(listed.file)) NameTendons(run, recorded->body.tendons());
        if (recorded && !IsLcmLog(listed.file)) other_cells.merge(TakeCells(run, *recorded, set.robot));
        if (listed.family != "unknown") run.family = listed.family;
        run.repeat_of = listed.repeat_of;
        run.before = listed.before;
        run.zero_at_rest = run.zero_at_rest || listed.zero_at_rest;
        SettleCell(run, listed.load_cell);
        set.runs.push_back(std::move(run));
      }
    } catch (const OtherRobotError&) {
      throw;
    } catch (const std::exception& e) {
      set.notes.push_back(fmt::format("left out: {}", e.what()));
    }
  }
  if (!other_cells.empty()) {
    set.notes.push_back(
        fmt::format("the load cells (tendons {}) have another gain or zero than in {}, with which the "
                    "tensions were recorded: converted to those of the given robot file; if they were "
                    "recorded with that one, put it into the folder",
                    fmt::join(other_cells, ", "), (folder / "robot.yaml").string()));
  }
}

void AddFolder(DataSet& set, const RobotOfSet& robot, const fs::path& folder) {
  const std::size_t from = set.runs.size();
  const fs::path list_file = folder / "runs.yaml";
  const std::vector<fs::path> files = FilesIn(folder);
  std::vector<ListedRun> list;
  std::error_code ignored;
  if (fs::exists(list_file, ignored)) {
    try {
      list = ReadList(list_file, set);
    } catch (const std::exception& e) {
      set.notes.push_back(fmt::format("{}; every CSV file is taken as a run of unknown family", e.what()));
    }
    std::set<fs::path> listed;
    for (ListedRun& run : list) {
      if (run.file.is_relative()) run.file = folder / run.file;
      listed.insert(run.file.lexically_normal());
    }
    if (!list.empty()) {
      std::string others;
      for (const fs::path& file : files) {
        if (HasEnding(file, ".csv") && !listed.contains(file.lexically_normal())) {
          others += (others.empty() ? "" : ", ") + file.filename().string();
        }
      }
      if (!others.empty()) {
        set.notes.push_back(
            fmt::format("{}: not listed, so left out: {}", list_file.string(), Printable(others, 200)));
      }
    }
  }
  if (list.empty()) {
    const bool logs = std::any_of(files.begin(), files.end(), [](const fs::path& f) { return IsLcmLog(f); });
    for (const fs::path& file : files) {
      if (logs ? IsLcmLog(file) : HasEnding(file, ".csv")) list.push_back({.file = file});
    }
  }
  AddRuns(set, robot, folder, list);
  SettleNames(set.runs, from, set.notes);
}

[[noreturn]] void ThrowNothing(const DataSet& set, const std::string& where) {
  std::string why;
  for (const std::string& note : set.notes) why += "\n  " + note;
  throw std::runtime_error(fmt::format(
      "{}: no usable run; accepted: CSV files with the column t_s, listed in runs.yaml, or LCM logs{}", where,
      why));
}

std::string NameOf(const fs::path& path) {
  const fs::path normal = fs::absolute(path).lexically_normal();
  return normal.has_filename() ? normal.filename().string() : normal.parent_path().filename().string();
}

bool HoldsRuns(const fs::path& folder) {
  const std::vector<fs::path> files = FilesIn(folder);
  return std::any_of(files.begin(), files.end(), [](const fs::path& file) {
    return file.filename() == "runs.yaml" || HasEnding(file, ".csv") || IsLcmLog(file);
  });
}

/// The robot of a folder, from its robot.yaml or from the first log.
std::optional<RobotParameters> RobotOf(const fs::path& folder) {
  if (auto robot = RecordedWith(folder)) return robot;
  for (const fs::path& file : FilesIn(folder)) {
    if (!IsLcmLog(file)) continue;
    try {
      return config::ParseRobot(RobotYamlOfLog(file), file.string());
    } catch (const std::exception&) {
      return std::nullopt;
    }
  }
  return std::nullopt;
}

/// For a folder without runs, as the demo leaves it: its subfolders that hold runs, of the named robot or of
/// one robot. Those of other robots are noted.
std::vector<std::string> RunFolders(const std::string& path, const std::string& robot_path,
                                    std::vector<std::string>& notes) {
  std::error_code error;
  if (!fs::is_directory(path, error) || HoldsRuns(path)) return {path};
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(path, error)) {
    if (entry.is_directory(error) && HoldsRuns(entry.path())) folders.push_back(entry.path());
  }
  std::sort(folders.begin(), folders.end());
  std::vector<std::string> taken;
  std::string others;
  std::optional<RobotParameters> robot;
  if (!robot_path.empty()) robot = sim::LoadRobot(robot_path);
  for (const fs::path& folder : folders) {
    const std::optional<RobotParameters> its = RobotOf(folder);
    if (its && !robot) robot = its;
    if (!its || its->name == robot->name) {
      taken.push_back(folder.string());
      continue;
    }
    others += fmt::format("{}{} is of robot '{}'", others.empty() ? "" : ", ", folder.filename().string(),
                          its->name);
  }
  if (others.empty()) return folders.empty() ? std::vector<std::string>{path} : taken;
  if (taken.empty() || robot_path.empty()) {
    throw std::runtime_error(fmt::format(
        "{}: {}, {} '{}'; give the robot file (--robot) of the runs to diagnose, or only their folder", path,
        others, robot_path.empty() ? "others of" : "the robot named is", robot->name));
  }
  notes.push_back(fmt::format("{}: {}, not '{}', and is left out; diagnose it with its own --robot", path,
                              others, robot->name));
  return taken;
}

// A run named twice would look like one that repeats without any noise.
void RefuseTwice(const std::vector<std::string>& paths) {
  for (std::size_t i = 0; i < paths.size(); ++i) {
    for (std::size_t k = 0; k < paths.size(); ++k) {
      std::error_code ignored;
      if (k < i && fs::equivalent(paths[k], paths[i], ignored))
        throw std::runtime_error(paths[i] + ": named twice; name each folder and file once");
      if (!fs::is_directory(paths[i], ignored) &&
          fs::equivalent(fs::absolute(paths[i], ignored).parent_path(), paths[k], ignored)) {
        throw std::runtime_error(
            fmt::format("{}: lies in {}, which is named as well; name either", paths[i], paths[k]));
      }
    }
  }
}

}  // namespace

void RequireAMotorForEachTendon(const RobotParameters& robot) {
  if (!robot.actuation || robot.actuation->pairs.empty()) return;
  throw std::runtime_error(fmt::format(
      "robot '{}' has antagonistic pairs; accepted: robots with a motor for every tendon, or many "
      "states of motors' positions and markers, without torques and tensions, in gap calibrate and "
      "gap diagnose --before",
      robot.name));
}

DataSet LoadDataSet(const fs::path& folder, const std::string& robot_path, OtherRobot other_robot) {
  if (std::error_code error; !fs::is_directory(folder, error)) {
    throw std::runtime_error(folder.string() +
                             ": no such folder; name a folder with robot.yaml, runs.yaml and CSV files");
  }
  return LoadLogs({folder.string()}, robot_path, other_robot);
}

DataSet LoadLogs(const std::vector<std::string>& named, const std::string& robot_path,
                 OtherRobot other_robot) {
  if (named.empty()) throw std::runtime_error("no run is named; name a folder, a CSV file or an LCM log");
  DataSet set;
  std::vector<std::string> paths;
  for (const std::string& path : named) {
    for (std::string& folder : RunFolders(path, robot_path, set.notes)) paths.push_back(std::move(folder));
  }
  RefuseTwice(paths);
  std::string robot_from = robot_path;
  std::optional<std::string> other;
  std::set<std::string> beside;  // robot files of folders, except the one used
  const auto offer = [&](const fs::path& file) {
    std::error_code ignored;
    if (!fs::exists(file, ignored)) return;
    if (robot_from.empty()) {
      robot_from = file.string();
    } else if (!fs::equivalent(robot_from, file, ignored)) {
      beside.insert(file.string());
      if (robot_path.empty() && ReadBytes(robot_from) != ReadBytes(file)) other = file.string();
    }
  };
  for (const std::string& path : paths) {
    std::error_code error;
    if (!fs::exists(path, error)) {
      throw std::runtime_error(path +
                               ": no such file or folder; name a folder with runs, a CSV file or an LCM log");
    }
    offer(fs::is_directory(path, error) ? fs::path(path) / "robot.yaml"
                                        : fs::path(path).parent_path() / "robot.yaml");
  }
  if (!robot_from.empty()) {
    set.robot = sim::LoadRobot(robot_from);
  } else {
    std::vector<fs::path> files;
    for (const std::string& path : paths) {
      std::error_code error;
      if (!fs::is_directory(path, error)) {
        files.emplace_back(path);
      } else {
        const auto in_folder = FilesIn(path);
        files.insert(files.end(), in_folder.begin(), in_folder.end());
      }
    }
    const auto log = std::find_if(files.begin(), files.end(), [](const fs::path& f) { return IsLcmLog(f); });
    const std::string yaml = log == files.end() ? std::string() : RobotYamlOfLog(*log);
    if (yaml.empty()) {
      throw std::runtime_error(
          paths.front() + ": no robot.yaml there; accepted: a robot file in the folder, or named by --robot");
    }
    set.robot = config::ParseRobot(yaml, "robot of " + log->string());
    set.notes.push_back("the robot is the one with which " + log->string() + " was recorded");
  }
  if (other) {
    set.notes.push_back(fmt::format("{} differs from {}, which is used for all runs; give --robot to choose",
                                    *other, robot_from));
  }

  const RobotOfSet robot(set.robot, robot_from.empty() ? "the robot of the first log" : robot_from,
                         other_robot);
  for (const std::string& file : beside) {
    if (const auto recorded = RecordedWith(fs::path(file).parent_path()))
      robot.Check(*recorded, file, set.notes);
  }

  set.name = NameOf(named.front());
  for (const std::string& path : paths) {
    std::error_code error;
    if (fs::is_directory(path, error)) {
      AddFolder(set, robot, path);
    } else {
      const std::size_t from = set.runs.size();
      AddRuns(set, robot, fs::path(path).parent_path(), {{.file = path}});
      SettleNames(set.runs, from, set.notes);
    }
  }
  if (set.runs.empty()) ThrowNothing(set, paths.front());
  for (Run& run : set.runs) CompletePairs(set.robot, run);
  if (!ShowsPostures(set)) RequireAMotorForEachTendon(set.robot);
  return set;
}

void WriteDataSet(const DataSet& set, const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw std::runtime_error("cannot make folder " + folder.string() + ": " + error.message());
  std::set<std::string> written;
  for (const Run& run : set.runs) {
    if (run.name.empty() || run.name.find('/') != run.name.npos) {
      throw std::runtime_error(
          fmt::format("a run is called '{}'; accepted: a file name without folder", run.name));
    }
    const std::string file = FileOf(run.name);
    if (!written.insert(file).second) {
      throw std::runtime_error(
          fmt::format("two runs would be written to '{}'; each needs a name of its own", file));
    }
    WriteRun(run, folder / file);
  }
  const auto write = [&](const char* name, const std::string& text) {
    std::ofstream out(folder / name, std::ios::binary);
    out << text;
    if (!out.flush()) throw std::runtime_error("cannot write " + (folder / name).string());
  };
  write("runs.yaml", ListText(set));
  write("robot.yaml", config::ToYaml(set.robot));
}

}  // namespace tendril::gap
