// What numbers of the messages mean, and what the gate accepts in a mode, from the tables that the daemon
// itself uses.
#include "tendril/core/status.h"

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <optional>
#include <string>

#include "mode_request.h"
#include "module.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/canopen/emcy.h"
#include "tendril/config/config.h"
#include "tendril/control/gate.h"
#include "tendril/core/usage_error.h"
#include "tendril/io/status_text.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;

Command CommandNamed(const std::string& name) {
  Command command;
  if (const auto request = FindModeRequest(name)) {
    command.kind = CommandKind::kMode;
    command.mode = *request;
  } else if (name == "target") {
    command.kind = CommandKind::kBending;
  } else {
    throw UsageError("'" + name + "' is no command; accepted: arm, disarm, hold, clear, target");
  }
  return command;
}

std::optional<std::string> DriveErrorText(const DaemonParameters& daemon, int node_id, int code) {
  for (const NodeParameters& node : daemon.bus.nodes) {
    if (node.node_id != node_id) continue;
    return canopen::FindEmcy(canopen::EmcyOf(node.profile), static_cast<std::uint16_t>(code)).text;
  }
  return std::nullopt;
}

}  // namespace

void AddStatus(nb::module_& m) {
  m.def(
      "status_text", [](int number) { return std::string(StatusText(static_cast<Status>(number))); },
      nb::arg("number"), "Meaning of a status number.");
  m.def(
      "status_remedy", [](int number) { return std::string(StatusRemedy(static_cast<Status>(number))); },
      nb::arg("number"), "What to do about it; empty where nothing is needed.");
  m.def(
      "drive_state_text", [](int state) { return std::string(io::DriveStateText(state)); }, nb::arg("state"),
      "A drive's state (cycle_t.DRIVE_...) in words.");
  m.def("drive_error_text", &DriveErrorText, nb::arg("daemon"), nb::arg("node_id"), nb::arg("code"),
        "What an emergency code means to the drive at a node of this daemon; None for another node.");
  m.def(
      "accepted_in",
      [](int mode, const std::string& command) {
        return control::CommandGate::AcceptedIn(static_cast<Mode>(mode), CommandNamed(command));
      },
      nb::arg("mode"), nb::arg("command"),
      "Whether the daemon's gate accepts 'arm', 'disarm', 'hold', 'clear' or a 'target' in a mode "
      "(state_t.MODE_...).");
}

}  // namespace tendril::python
