// The EPOS4 as a profile: its parts together, and its PDOs.
#include "epos4.h"

namespace tendril::canopen {
namespace {

constexpr DrivePdos kPdos{
    .torque = {.transmit = false,
               .number = 1,
               .transmission = 1,
               .inhibit_100us = 0,
               .count = 2,
               .entries = {{{0x6040, 0, 16, false}, {0x6071, 0, 16, true}}}},
    .feedback = {.transmit = true,
                 .number = 1,
                 .transmission = 1,
                 .inhibit_100us = 0,
                 .count = 3,
                 .entries = {{{0x6064, 0, 32, true}, {0x6077, 0, 16, true}, {0x3160, 1, 16, true}}}},
    // On change, at most every 10 ms.
    .status = {.transmit = true,
               .number = 2,
               .transmission = 255,
               .inhibit_100us = 100,
               .count = 1,
               .entries = {{{0x6041, 0, 16, false}}}}};

}  // namespace

DriveProfilePtr Epos4Profile() {
  static const DriveProfilePtr profile = [] {
    DriveProfile p;
    p.name = "maxon EPOS4";
    p.objects = epos4::Objects();
    p.pdos = kPdos;
    p.analog_input = {0x3160, 1};
    p.rated_torque_unit_uNm = 1;
    p.rated_torque_source = "torque constant x nominal current";
    p.identity_source = "bus.identity";
    p.emcy = epos4::EmcyTable();
    p.boot_script = epos4::BootScript;
    return std::make_shared<const DriveProfile>(std::move(p));
  }();
  return profile;
}

}  // namespace tendril::canopen
