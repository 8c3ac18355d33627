// What is done with a commissioning's findings: the table for people, the nodes' lines of the daemon file,
// the record. Knows nothing of how they were found.
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <regex>
#include <stdexcept>

#include "tendril/commission/commission.h"
#include "tendril/core/angle.h"
#include "tendril/core/version.h"

namespace tendril::commission {
namespace {

std::string Value(double value, double scale, int decimals) {
  return std::isnan(value) ? "-" : fmt::format("{:.{}f}", scale * value, decimals);
}

const char* SignText(int sign) { return sign > 0 ? "+" : sign < 0 ? "REVERSED" : "none"; }

}  // namespace

std::string CommissionTable(const CommissionResult& result) {
  std::string t = fmt::format("one motor at a time, at most {:g} N\n\n", result.pull_N);
  t += fmt::format("{:<8}{:>5}{:>10}{:>10}{:>9}{:>8}{:>7}{:>10}{:>8}{:>18}{:>11}   {}\n", "tendon", "node",
                   "torque", "encoder", "bends to", "tendon", "cell", "zero [N]", "gain", "shows (may) [N]",
                   "wound [mm]", "verdict");
  for (const DriveFinding& f : result.drives) {
    const std::string shows = std::isnan(f.pulled_N)
                                  ? "-"
                                  : fmt::format("{:.2f} ({:.2f}..{:.2f})", f.pulled_N, f.least_N, f.most_N);
    t += fmt::format("{:<8}{:>5}{:>10}{:>10}{:>9}{:>8}{:>7}{:>10}{:>8}{:>18}{:>11}   {}\n", f.tendon,
                     f.node.node_id, SignText(f.torque_sign), SignText(f.encoder_sign),
                     Value(f.seen_angle_rad, kDegreesPerRadian, 0),
                     f.seen_tendon == 0 ? "-" : std::to_string(f.seen_tendon),
                     f.cell_tendon == 0 ? "-" : std::to_string(f.cell_tendon), Value(f.cell_zero_N, 1, 3),
                     Value(f.cell_gain, 1, 2), shows, Value(f.slack_m, 1e3, 1), f.verdict);
  }
  for (const DriveFinding& f : result.drives) {
    for (const Disagreement& d : f.disagreements) t += fmt::format("\n{}\n  -> {}\n", d.what, d.remedy);
  }
  return t;
}

std::vector<NodeParameters> FoundNodes(const CommissionResult& result) {
  std::vector<NodeParameters> nodes;
  for (const DriveFinding& f : result.drives) {
    if (f.torque_sign == 0 || f.encoder_sign == 0 || f.seen_tendon == 0) return {};
    NodeParameters n = f.node;
    n.tendon = f.seen_tendon;
    if (f.torque_sign < 0) n.motor_reversed = !n.motor_reversed;
    if (f.encoder_sign < 0) n.encoder_reversed = !n.encoder_reversed;
    const bool twice = std::any_of(nodes.begin(), nodes.end(),
                                   [&n](const NodeParameters& other) { return other.tendon == n.tendon; });
    if (twice) return {};
    nodes.push_back(n);
  }
  return nodes;
}

namespace {

// What a node's line says beside the wiring, with a comma before it: which drive it is.
std::string OtherKeys(const std::string& inside) {
  static const std::regex kOther(
      R"((profile|eds|analog_input|analog_mV_per_count)\s*:\s*("[^"]*"|'[^']*'|[^,]*[^,\s]))");
  std::string keys;
  for (std::sregex_iterator at(inside.begin(), inside.end(), kOther), end; at != end; ++at)
    keys += ", " + at->str();
  return keys;
}

}  // namespace

std::string PatchNodes(const std::string& text, const std::string& path,
                       const std::vector<NodeParameters>& nodes) {
  std::string out;
  std::size_t patched = 0;
  static const std::regex kNode(R"(^(\s*-\s*)\{(?=[^}]*node_id:\s*(\d+))([^}]*)\}(.*)$)");
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    std::string line = text.substr(from, end - from);
    std::smatch match;
    if (std::regex_match(line, match, kNode)) {
      for (const NodeParameters& n : nodes) {
        if (n.node_id != std::atoi(match[2].str().c_str())) continue;
        line = fmt::format("{}{{node_id: {}, tendon: {}{}{}{}}}{}", match[1].str(), n.node_id, n.tendon,
                           n.motor_reversed ? ", motor: reversed" : "",
                           n.encoder_reversed ? ", encoder: reversed" : "", OtherKeys(match[3].str()),
                           match[4].str());
        ++patched;
        break;
      }
    }
    out += line + (end < text.size() ? "\n" : "");
    from = end + 1;
  }
  if (patched != nodes.size()) {
    throw std::runtime_error(path +
                             ": bus.nodes does not have one line `- {node_id: N, tendon: M}` per node; "
                             "change it by hand as stated above");
  }
  return out;
}

daemon::CommissioningRecord RecordOf(const CommissionResult& result, const RobotParameters& robot,
                                     const DaemonParameters& daemon, const DriveSerials& serials) {
  daemon::CommissioningRecord record;
  record.wiring = daemon::WiringHash(robot, daemon.bus);
  record.at = fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr)));
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  const char* user = std::getenv("USER");
  record.by = fmt::format("{}@{}", user != nullptr ? user : std::to_string(getuid()), host.data());
  std::erase_if(record.by,
                [](char c) { return c == '"' || c == '\\' || static_cast<unsigned char>(c) < ' '; });
  record.software = fmt::format("{} ({})", Version(), GitRevision());
  record.pull_N = result.pull_N;
  for (const DriveFinding& f : result.drives) {
    const auto serial = serials.find(f.node.node_id);
    record.tendons.push_back({.node_id = f.node.node_id,
                              .tendon = f.tendon,
                              .serial = serial == serials.end() ? 0 : serial->second,
                              .cell_zero_N = f.cell_zero_N,
                              .cell_gain = f.cell_gain,
                              .slack_m = f.slack_m,
                              .seen_angle_rad = f.seen_angle_rad});
  }
  return record;
}

}  // namespace tendril::commission
