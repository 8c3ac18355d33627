// The parts of the EPOS4's profile, a file each. Knows no other drive.
#pragma once

#include <span>
#include <vector>

#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen::epos4 {

ObjectTable Objects();
std::span<const EmcyInfo> EmcyTable() noexcept;
std::vector<BootAction> BootScript(const DriveProfile& profile, const BusParameters& bus,
                                   const DriveSetup& drive);

}  // namespace tendril::canopen::epos4
