// The parts of a generic CiA 402 drive's profile, a file each. Knows no maker.
#pragma once

#include <span>
#include <vector>

#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen::cia402 {

/// From the EDS file of the node. Throws std::invalid_argument, one line, when that is none or names no
/// vendor.
DriveProfilePtr Profile(const NodeParameters& node);
std::span<const EmcyInfo> EmcyTable() noexcept;
std::vector<BootAction> BootScript(const DriveProfile& profile, const BusParameters& bus,
                                   const DriveSetup& drive);

}  // namespace tendril::canopen::cia402
