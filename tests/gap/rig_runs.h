// Runs of the simulated 90 mm rig for tests of the diagnosis: recorded as its sensors show them, with or
// without an effect planted.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/plant.h"

namespace tendril {

RobotParameters Rig();

/// Motor torque [N m] that approximately holds a tension [N].
inline constexpr double kTorquePerN = 0.008 / 19;

/// Commanded base tensions [N] of a family's run at time t [s].
Eigen::Vector3d CommandedTension(const std::string& family, double t);

/// A run of rows without readings, the last of them at `last_s`.
gap::Run EmptyRun(const std::string& family, int rows, double last_s);
/// Enters what drives, cells and (where `tracked`) the tracker read now into a row, with the numbers of the
/// nominal robot.
void ReadRow(sim::Plant& plant, const RobotParameters& nominal, bool tracked, int row, gap::Run& run);

/// Friction torque at a motor's shaft in addition to the plant's, as a function of its state and the time.
using Rub = std::function<double(int j, const sim::TendonState& state, double time_s)>;

/// One run of a plant as the rig's sensors record it, a row a cycle of the controller, the tracker at 100 Hz.
gap::Run Record(sim::Plant& plant, const std::string& family, double duration_s, const Rub& rub = nullptr,
                int rows_Hz = 1000);
gap::Run Record(const RobotParameters& plant_robot, const std::string& family, double duration_s,
                std::uint64_t seed, int rows_Hz = 1000);

/// Numbers of the file that are each within what is usual of such a number, and together far from the file.
extern const std::vector<std::string> kNumbersOff;

/// Takes every number of the file as exact.
void KnowEveryNumber(RobotParameters& robot);

/// Three families and a repetition.
gap::DataSet Recorded(const std::vector<std::string>& effects, double duration_s = 5, std::uint64_t seed = 11,
                      int rows_Hz = 1000);
gap::DataSet Recorded(const std::string& effect, double duration_s = 5);
/// The same by a controller of half the rate, which takes half the time to diagnose.
gap::DataSet RecordedAt500Hz(const std::string& effect, double duration_s = 5);
/// Of these, two families and the repetition, where the third tells nothing more.
gap::DataSet TwoFamilies(const std::string& effect, double duration_s);

/// With the load cells between pulleys and robot; the last run repeats the first.
gap::DataSet RecordedAtRobotSide(const std::string& effect, const std::vector<std::string>& families,
                                 double duration_s, std::uint64_t seed, int rows_Hz = 1000);

/// Keeps these rows of a run, in this order.
void KeepRows(gap::Run& run, const std::vector<Eigen::Index>& rows);
/// Keeps every n-th row of a run, from row `first` on.
void KeepEveryNth(gap::Run& run, int n, Eigen::Index first = 0);
/// Removes `lost` rows of a run, from row `from` on.
void Lose(gap::Run& run, Eigen::Index lost, Eigen::Index from);
/// Removes 0.7 s of rows at a third of every run.
void LoseRows(gap::Run& run);
/// The row at a time [s] from the run's begin.
Eigen::Index RowAt(const gap::Run& run, double time_s);

/// The cause of this name; nullptr: not listed.
const gap::Cause* Named(const gap::Diagnosis& d, const std::string& effect);
/// Where the gap begins; C0: nowhere.
sim::Cut First(const gap::Diagnosis& d);
/// No effects but these, and no plan of the next experiment: less to search and to simulate.
gap::DiagnoseOptions Only(const std::vector<std::string>& effects);

}  // namespace tendril
