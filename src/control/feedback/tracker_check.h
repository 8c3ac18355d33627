// Compares the tracker with the tendons' estimate, also without tip feedback: the estimate relies on
// undamaged tendons and a correct zero.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

class TrackerCheck {
 public:
  explicit TrackerCheck(const RobotParameters& robot);

  /// Once per cycle; `applies` false: there is no estimate to compare with. kTrackerDisagrees after
  /// consecutive readings that are farther from the estimate than both can be.
  Status Step(const TrackerSample& seen, const Eigen::Vector3d& estimate_W_m, bool applies) noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  bool tracked_ = false;
  double allowed_m_ = 0;
  double late_readings_ = 0;  // readings that come before one shows a motion
  std::int32_t most_ = 0;     // readings that disagree before it is reported
  std::int32_t disagreeing_ = 0;
  bool disagrees_ = false;
  Eigen::Vector3d compared_W_m_{0, 0, 0};
};

}  // namespace tendril::control
