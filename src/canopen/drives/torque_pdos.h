// The PDOs of cyclic synchronous torque, alike in every drive. Knows CiA 402, no maker's objects.
#pragma once

#include <cstddef>
#include <optional>

#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen {

/// `analog_input`: the load cell's, where the drive reads one.
inline DrivePdos TorquePdos(const std::optional<MappingEntry>& analog_input) {
  DrivePdos pdos{.torque = {.transmit = false,
                            .number = 1,
                            .transmission = 1,
                            .inhibit_100us = 0,
                            .count = 2,
                            .entries = {{{0x6040, 0, 16, false}, {0x6071, 0, 16, true}}}},
                 .feedback = {.transmit = true,
                              .number = 1,
                              .transmission = 1,
                              .inhibit_100us = 0,
                              .count = 2,
                              .entries = {{{0x6064, 0, 32, true}, {0x6077, 0, 16, true}}}},
                 // On change, at most every 10 ms.
                 .status = {.transmit = true,
                            .number = 2,
                            .transmission = 255,
                            .inhibit_100us = 100,
                            .count = 1,
                            .entries = {{{0x6041, 0, 16, false}}}}};
  if (analog_input) pdos.feedback.entries[static_cast<std::size_t>(pdos.feedback.count++)] = *analog_input;
  return pdos;
}

}  // namespace tendril::canopen
