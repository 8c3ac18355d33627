// What the figures write into: findings, series, progress; and where they get their robots. Knows no physics.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "claims.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/io/csv.h"

namespace tendril::qi2021 {

/// A CSV file of the results.
class Series {
 public:
  Series(const std::filesystem::path& path, const std::vector<std::string>& columns);
  io::CsvWriter& row() { return writer_; }

 private:
  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  std::unique_ptr<std::FILE, Close> file_;
  io::CsvWriter writer_;
};

/// Finds a file of config/ by its name, "robots/rig_90mm.yaml".
using ConfigFinder = std::function<std::string(const std::string& name)>;
/// A stage and its completed share, 0 to 1; `ended`: the last word on it.
using StageProgress = std::function<void(const std::string& stage, double share, bool ended)>;

class Study {
 public:
  Study(std::filesystem::path folder, ConfigFinder find, StageProgress progress)
      : folder_(std::move(folder)), find_(std::move(find)), progress_(std::move(progress)) {}

  void Begin(const std::string& stage);
  void Progress(double share) { progress_(stage_, share, false); }
  /// Ends the last stage.
  void End();

  void Find(std::string_view id, Finding finding) { found_.push_back({ClaimNamed(id), std::move(finding)}); }
  const std::vector<JudgedClaim>& found() const { return found_; }

  Series OpenSeries(const std::string& name, const std::vector<std::string>& columns) const {
    return {folder_ / (name + ".csv"), columns};
  }
  RobotParameters Robot(const std::string& name) const;
  DaemonParameters Daemon() const;

 private:
  std::filesystem::path folder_;
  ConfigFinder find_;
  StageProgress progress_;
  std::vector<JudgedClaim> found_;
  std::string stage_;
};

/// Relative distance |ours - paper| / |paper|.
double Apart(double ours, double paper);

}  // namespace tendril::qi2021
