#include "tendril/exchange/dbc.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <numbers>
#include <vector>

#include "tendril/canopen/boot_script.h"
#include "tendril/canopen/wire.h"
#include "tendril/core/load_cell_place.h"
#include "tendril/core/plain_text.h"

namespace tendril::exchange {
namespace {

using canopen::DriveSetup;
using canopen::MappingEntry;

constexpr std::string_view kDaemon = "tendrild", kNmtStates =
                                                     "0 \"boot-up\" 4 \"stopped\" 5 \"operational\" "
                                                     "127 \"pre-operational\"";

/// As DBC has texts: what a maker's EDS file calls its drive may hold anything.
std::string Quoted(const std::string& text) {
  std::string plain = PlainText(text);
  std::replace(plain.begin(), plain.end(), '"', '?');
  return plain;
}

/// A value of a frame, in the order in which the frame carries them.
struct Signal {
  std::string name;
  int bits = 0;
  bool is_signed = false;
  double factor = 1, offset = 0;
  std::string unit{}, comment{}, values{};
};

struct Message {
  std::uint32_t id = 0;
  std::string name, sender, receiver;
  std::vector<Signal> signals{};
  std::string comment{};
  int period_ms = 0;  // 0: not cyclic
};

/// One drive in the words of the robot's file.
struct Drive {
  const DriveSetup& setup;
  const NodeParameters& node;
  const TendonDriveParameters& parts;
  std::string name() const { return fmt::format("drive{}", setup.node_id); }
};

Signal LoadCell(const Drive& drive) {
  const LoadCellParameters& cell = drive.parts.load_cell;
  const double mV = drive.setup.profile->analog_mV_per_count;
  if (cell.place == LoadCellPlace::kNone || !(cell.gain_VpN > 0))
    return {.name = "AnalogInput", .factor = mV, .unit = "mV", .comment = "Analog input; no load cell."};
  return {.name = "Tension",
          .factor = mV * 1e-3 / cell.gain_VpN,
          .offset = 0 - cell.offset_N,  // never -0
          .unit = "N",
          .comment = fmt::format("Load cell, {}.", LoadCellPlaceText(cell.place))};
}

/// What an entry of a PDO is, by its object.
Signal SignalOf(const Drive& drive, const MappingEntry& entry) {
  const double torque_Nm = drive.parts.drive.rated_torque_Nm / 1000 * (drive.node.motor_reversed ? -1 : 1);
  const double angle_rad = 2 * std::numbers::pi / drive.parts.drive.encoder_counts_per_turn *
                           (drive.node.encoder_reversed ? -1 : 1);
  Signal signal{.name = fmt::format("Object{:04X}_{:02X}", entry.index, entry.sub)};
  switch (entry.index) {
    case 0x6040:
      signal = {.name = "Controlword", .comment = "CiA 402."};
      break;
    case 0x6041:
      signal = {.name = "Statusword", .comment = "CiA 402."};
      break;
    case 0x6071:
      signal = {.name = "TargetTorque",
                .factor = torque_Nm,
                .unit = "Nm",
                .comment = "At the motor shaft, pulling positive; acts at the next SYNC."};
      break;
    case 0x6077:
      signal = {.name = "ActualTorque",
                .factor = torque_Nm,
                .unit = "Nm",
                .comment = "At the motor shaft, by the motor's current, pulling positive."};
      break;
    case 0x6064:
      signal = {.name = "Position",
                .factor = angle_rad,
                .unit = "rad",
                .comment = "Of the motor shaft, latched at the SYNC, pulling positive."};
      break;
    default:
      if (drive.setup.profile->analog_input == canopen::ObjectAddress{entry.index, entry.sub})
        signal = LoadCell(drive);
  }
  signal.bits = entry.bits;
  signal.is_signed = entry.is_signed;
  return signal;
}

Message Pdo(const Drive& drive, const canopen::PdoLayout& layout, const std::string& what, int period_ms) {
  const int node = drive.setup.node_id, number = layout.number;
  Message message{.id = layout.transmit ? canopen::TpdoCobId(number, node) : canopen::RpdoCobId(number, node),
                  .name = drive.name() + "_" + what,
                  .sender = layout.transmit ? drive.name() : std::string(kDaemon),
                  .receiver = layout.transmit ? std::string(kDaemon) : drive.name(),
                  .comment = fmt::format("{} {} of node {}, the drive of tendon {}.",
                                         layout.transmit ? "TPDO" : "RPDO", number, node, drive.node.tendon),
                  .period_ms = period_ms};
  for (int i = 0; i < layout.count; ++i)
    message.signals.push_back(SignalOf(drive, layout.entries[static_cast<std::size_t>(i)]));
  return message;
}

Message Emergency(const Drive& drive) {
  std::string codes;
  for (const canopen::EmcyInfo& info : drive.setup.profile->emcy) {
    if (info.first == info.last) codes += fmt::format("{} \"{}\" ", info.first, info.text);
  }
  return {.id = canopen::kEmcyBase + static_cast<std::uint32_t>(drive.setup.node_id),
          .name = drive.name() + "_Emergency",
          .sender = drive.name(),
          .receiver = std::string(kDaemon),
          .signals = {{.name = "ErrorCode", .bits = 16, .values = codes},
                      {.name = "ErrorRegister", .bits = 8, .comment = "Object 0x1001."},
                      {.name = "Vendor", .bits = 40, .comment = "Manufacturer-specific."}},
          .comment = "EMCY; code 0: an earlier error was cleared."};
}

Message Heartbeat(const std::string& sender, const std::string& receiver, int node, int period_ms) {
  return {.id = canopen::kHeartbeatBase + static_cast<std::uint32_t>(node),
          .name = sender + "_Heartbeat",
          .sender = sender,
          .receiver = receiver,
          .signals = {{.name = "NmtState", .bits = 8, .values = std::string(kNmtStates)}},
          .comment = fmt::format("Node {}.", node),
          .period_ms = period_ms};
}

Message Sdo(const Drive& drive, bool request) {
  const auto node = static_cast<std::uint32_t>(drive.setup.node_id);
  return {.id = (request ? canopen::kSdoRequestBase : canopen::kSdoResponseBase) + node,
          .name = drive.name() + (request ? "_SdoRequest" : "_SdoResponse"),
          .sender = request ? std::string(kDaemon) : drive.name(),
          .receiver = request ? drive.name() : std::string(kDaemon),
          .signals = {{.name = "Command", .bits = 8},
                      {.name = "Index", .bits = 16},
                      {.name = "SubIndex", .bits = 8},
                      {.name = "Data", .bits = 32}},
          .comment = "Start-up and figures that are not in a PDO; expedited transfers."};
}

std::vector<Message> MessagesOf(const BusParameters& bus, const std::vector<Drive>& drives) {
  const int cycle_ms = static_cast<int>((bus.cycle_ns + kNsPerMs / 2) / kNsPerMs);
  const std::string daemon(kDaemon);
  std::vector<std::string> names;
  for (const Drive& drive : drives) names.push_back(drive.name());
  const std::string all = fmt::format("{}", fmt::join(names, ","));
  std::vector<Message> messages = {
      {.id = canopen::kNmtCobId,
       .name = "Nmt",
       .sender = daemon,
       .receiver = all,
       .signals = {{.name = "Command",
                    .bits = 8,
                    .values = "1 \"start\" 2 \"stop\" 128 \"enter pre-operational\" 129 \"reset node\" "
                              "130 \"reset communication\""},
                   {.name = "Node", .bits = 8, .comment = "0: all nodes."}},
       .comment = "Network management."},
      {.id = canopen::kSyncCobId,
       .name = "Sync",
       .sender = daemon,
       .receiver = all,
       .comment = "Begins a cycle: drives latch their positions, and the torques that they got begin to act.",
       .period_ms = cycle_ms}};
  if (bus.heartbeat_ms > 0)
    messages.push_back(Heartbeat(daemon, all, canopen::kMasterNodeId, bus.heartbeat_ms));
  for (const Drive& drive : drives) {
    const canopen::DrivePdos& pdos = drive.setup.profile->pdos;
    messages.push_back(Pdo(drive, pdos.torque, "Torque", cycle_ms));
    messages.push_back(Pdo(drive, pdos.feedback, "Feedback", cycle_ms));
    messages.push_back(Pdo(drive, pdos.status, "Status", pdos.status.transmission == 1 ? cycle_ms : 0));
    messages.push_back(Emergency(drive));
    messages.push_back(Heartbeat(drive.name(), daemon, drive.setup.node_id, bus.heartbeat_ms));
    messages.push_back(Sdo(drive, true));
    messages.push_back(Sdo(drive, false));
  }
  return messages;
}

std::string MessageText(const Message& message) {
  int bits = 0;
  std::string lines;
  for (const Signal& s : message.signals) {
    // The range is what the bits can carry, which every program works out by itself: 0 and 0 says so.
    lines += fmt::format(" SG_ {} : {}|{}@1{} ({:.15g},{:.15g}) [0|0] \"{}\" {}\n", s.name, bits, s.bits,
                         s.is_signed ? '-' : '+', s.factor, s.offset, s.unit, message.receiver);
    bits += s.bits;
  }
  return fmt::format("BO_ {} {}: {} {}\n{}\n", message.id, message.name, bits / 8, message.sender, lines);
}

std::string CommentsOf(const Message& message) {
  std::string text = fmt::format("CM_ BO_ {} \"{}\";\n", message.id, message.comment);
  for (const Signal& s : message.signals) {
    if (!s.comment.empty()) text += fmt::format("CM_ SG_ {} {} \"{}\";\n", message.id, s.name, s.comment);
  }
  return text;
}

std::string ValuesOf(const Message& message) {
  std::string text;
  for (const Signal& s : message.signals) {
    if (!s.values.empty()) text += fmt::format("VAL_ {} {} {} ;\n", message.id, s.name, s.values);
  }
  return text;
}

std::vector<Drive> DrivesOf(const RobotParameters& robot, const BusParameters& bus,
                            std::span<const DriveSetup> setups) {
  std::vector<Drive> drives;
  for (const DriveSetup& setup : setups) {
    for (const NodeParameters& node : bus.nodes) {
      if (node.node_id == setup.node_id)
        drives.push_back({setup, node, robot.actuation->tendons[static_cast<std::size_t>(node.tendon - 1)]});
    }
  }
  return drives;
}

}  // namespace

std::string Dbc(const RobotParameters& robot, const BusParameters& bus, std::span<const DriveSetup> setups) {
  const std::vector<Drive> drives = DrivesOf(robot, bus, setups);
  const std::vector<Message> messages = MessagesOf(bus, drives);
  std::string text = fmt::format("VERSION \"{}\"\n\nNS_ :\n\nBS_:\n\nBU_: {}", robot.name, kDaemon);
  for (const Drive& drive : drives) text.append(" ").append(drive.name());
  text += "\n\n";
  for (const Message& message : messages) text += MessageText(message);
  text += fmt::format(
      "CM_ \"The bus of robot {}: {} bit/s. Torques and angles at the motor shaft, pulling positive.\";\n",
      robot.name, bus.bitrate_bps);
  for (const Drive& drive : drives)
    text += fmt::format("CM_ BU_ {} \"{}, pulls tendon {}.\";\n", drive.name(),
                        Quoted(drive.setup.profile->name), drive.node.tendon);
  for (const Message& message : messages) text += CommentsOf(message);
  text +=
      "BA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 65535;\nBA_DEF_ \"Baudrate\" INT 0 1000000;\n"
      "BA_DEF_DEF_ \"GenMsgCycleTime\" 0;\nBA_DEF_DEF_ \"Baudrate\" 1000000;\n";
  text += fmt::format("BA_ \"Baudrate\" {};\n", bus.bitrate_bps);
  for (const Message& message : messages) {
    if (message.period_ms > 0)
      text += fmt::format("BA_ \"GenMsgCycleTime\" BO_ {} {};\n", message.id, message.period_ms);
  }
  for (const Message& message : messages) text += ValuesOf(message);
  return text;
}

}  // namespace tendril::exchange
