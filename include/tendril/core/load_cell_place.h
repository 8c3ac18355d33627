// The words for a load cell's place, in files, on the command line and in Python.
#pragma once

#include <initializer_list>
#include <optional>
#include <string_view>
#include <utility>

#include "tendril/core/robot.h"

namespace tendril {

inline const std::initializer_list<std::pair<std::string_view, LoadCellPlace>> kLoadCellPlaces = {
    {"motor_side", LoadCellPlace::kMotorSide},  // between spool and pulleys
    {"robot_side", LoadCellPlace::kRobotSide},  // between pulleys and base
    {"none", LoadCellPlace::kNone}};
/// All of them, for messages.
inline constexpr std::string_view kLoadCellPlaceWords = "motor_side, robot_side, none";

std::string_view LoadCellPlaceText(LoadCellPlace place);
std::optional<LoadCellPlace> FindLoadCellPlace(std::string_view text);

}  // namespace tendril
