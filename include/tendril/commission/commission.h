// Commissioning: the motors pull gently, one after the other, and the answers of encoders, load cells and tip
// show how the robot is wired. The procedure and its conclusions; knows nothing of LCM or the command line.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/daemon/commissioning.h"

namespace tendril::commission {

/// A controller in mode commissioning, from its operator's side.
class CommissionLink {
 public:
  virtual ~CommissionLink() = default;
  /// Commands the pull of each bare motor [N, +-], in tendon order; Next keeps it valid.
  virtual void Pull(const TendonVector& pull_N) = 0;
  /// Waits for the next cycle. Throws std::runtime_error when there is none, or when the mode was left.
  virtual const CycleRecord& Next() = 0;
};

/// A difference from the files, and its remedy.
struct Disagreement {
  std::string what, remedy;
};

/// Findings for one drive; tendons count from 1. NaN: not measured.
struct DriveFinding {
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  int tendon = 0;        // according to the files
  NodeParameters node;   // likewise
  int torque_sign = 0;   // +1: positive torque pulls, as the files state; -1: it pays out; 0: unknown
  int encoder_sign = 0;  // +1: it counts as the files state
  int seen_tendon = 0;   // tendon whose hole lies in the direction of the bend; 0: unknown
  double seen_angle_rad = kUnknown;
  int cell_tendon = 0;  // tendon of the drive whose input shows this tendon's tension; 0: none
  bool has_cell = true;
  double cell_zero_N = kUnknown, cell_gain = kUnknown;
  double pulled_N = kUnknown, least_N = kUnknown,
         most_N = kUnknown;   // reading under pull; maximum allowed by the torque
  double slack_m = kUnknown;  // travel until it was taut; some of it bends the robot
  double friction_N = 0;      // of the motor, by the file
  std::string verdict;        // in a word or two
  std::vector<Disagreement> disagreements;
};

struct CommissionResult {
  double pull_N = 0;
  std::vector<DriveFinding> drives;  // in tendon order
  bool passed() const;
};

/// Called for each tendon without a tracker: the direction of the bend as seen by a person [rad, base frame,
/// from +x towards +y], empty when unknown. `keep_going` must be called some ten times a second.
using AskDirection =
    std::function<std::optional<double>(int tendon, const std::function<void()>& keep_going)>;

/// The whole procedure on a robot in mode commissioning. `tell` receives a line for each step.
CommissionResult Commission(CommissionLink& link, const RobotParameters& robot,
                            const DaemonParameters& daemon, const AskDirection& ask,
                            const std::function<void(const std::string&)>& tell);

/// A table with one row per tendon, then the disagreements with their remedies.
std::string CommissionTable(const CommissionResult& result);

/// Node list according to the findings; empty when a drive stays open.
std::vector<NodeParameters> FoundNodes(const CommissionResult& result);

/// `text` of a daemon file with its node list changed to `nodes`; throws std::runtime_error when the list
/// does not have one node per line.
std::string PatchNodes(const std::string& text, const std::string& path,
                       const std::vector<NodeParameters>& nodes);

/// Serial numbers of drives by node id.
using DriveSerials = std::map<int, std::uint32_t>;

/// The record of a passed result; drives without an entry in `serials` are recorded as unknown.
daemon::CommissioningRecord RecordOf(const CommissionResult& result, const RobotParameters& robot,
                                     const DaemonParameters& daemon, const DriveSerials& serials);

}  // namespace tendril::commission
