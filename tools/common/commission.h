// Commissioning: single motors pull gently, one after the other, and what encoders, load cells and the tip
// answer tells how the robot is wired. The procedure and what follows from it; knows nothing of LCM or the
// command line.
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

namespace tendril::tools {

/// A controller in mode commissioning, as its operator has it.
class CommissionLink {
 public:
  virtual ~CommissionLink() = default;
  /// Wanted from now on, kept fresh by Next: the pull of each bare motor [N, +-], in tendon order.
  virtual void Pull(const TendonVector& pull_N) = 0;
  /// The next cycle. Throws std::runtime_error when there is none, or when the mode was left.
  virtual const CycleRecord& Next() = 0;
};

/// Something that is not as the files say, and what to do about it.
struct Disagreement {
  std::string what, remedy;
};

/// What is known of one drive after all; tendons count from 1. NaN: not measured.
struct DriveFinding {
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  int tendon = 0;        // as the files have it
  NodeParameters node;   // the same
  int torque_sign = 0;   // +1: positive torque pulls, as the files say; -1: it pays out; 0: neither shows
  int encoder_sign = 0;  // +1: it counts as the files say
  int seen_tendon = 0;   // whose hole lies where the robot bent to; 0: not known
  double seen_angle_rad = kUnknown;
  int cell_tendon = 0;  // the drive whose input shows this tendon's tension; 0: none does
  bool has_cell = true;
  double cell_zero_N = kUnknown, cell_gain = kUnknown;
  double pulled_N = kUnknown, least_N = kUnknown,
         most_N = kUnknown;   // shown under pull; what the torque allows
  double slack_m = kUnknown;  // wound in from where it began until it was taut; some of it bends the robot
  double friction_N = 0;      // of the motor, by the file
  std::string verdict;        // in a word or two
  std::vector<Disagreement> disagreements;
};

struct CommissionResult {
  double pull_N = 0;
  std::vector<DriveFinding> drives;  // in tendon order
  bool passed() const;
};

/// Asked for each tendon when no tracker shows where the robot bends to: the direction that a person sees
/// [rad, base frame, from +x towards +y], empty when nobody knows. `keep_going` is to be called some ten
/// times a second.
using AskDirection =
    std::function<std::optional<double>(int tendon, const std::function<void()>& keep_going)>;

/// The whole procedure on a robot in mode commissioning. `tell` gets a line for each step.
CommissionResult Commission(CommissionLink& link, const RobotParameters& robot,
                            const DaemonParameters& daemon, const AskDirection& ask,
                            const std::function<void(const std::string&)>& tell);

/// A table, a row a tendon, then what disagrees, each with its remedy.
std::string CommissionTable(const CommissionResult& result);

/// Node list that the findings say; empty when they leave a drive open.
std::vector<NodeParameters> FoundNodes(const CommissionResult& result);

/// `text` of a daemon file with its node list changed to `nodes`; throws std::runtime_error when the list is
/// not written with a node a line.
std::string PatchNodes(const std::string& text, const std::string& path,
                       const std::vector<NodeParameters>& nodes);

/// Serial numbers of drives by node id.
using DriveSerials = std::map<int, std::uint32_t>;

/// What a result that passed leaves; drives without an entry in `serials` are recorded as not known.
daemon::CommissioningRecord RecordOf(const CommissionResult& result, const RobotParameters& robot,
                                     const DaemonParameters& daemon, const DriveSerials& serials);

}  // namespace tendril::tools
