#include "tendril/commission/findings_file.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/robot_file/robot_patch.h"

namespace tendril::commission {
void WriteFindings(const CommissionResult& result, const std::string& config_path,
                   const std::string& robot_path, const std::function<void(const std::string&)>& tell) {
  const std::vector<NodeParameters> nodes = FoundNodes(result);
  if (nodes.empty()) {
    throw std::runtime_error(
        "nothing is written: not every drive could be identified; correct the problems above and commission "
        "again");
  }
  bool same = true;
  std::vector<EffectSetting> zeros;
  for (const DriveFinding& f : result.drives) {
    for (const NodeParameters& n : nodes) {
      same = same && (n.node_id != f.node.node_id ||
                      (n.tendon == f.node.tendon && n.motor_reversed == f.node.motor_reversed &&
                       n.encoder_reversed == f.node.encoder_reversed));
    }
    if (f.verdict == "cell zero") {
      zeros.push_back({.name = "cell_offset",
                       .where = fmt::format("tendon:{}", f.seen_tendon),
                       .values = {{"N", std::round(1e4 * f.cell_zero_N) / 1e4}}});
    }
  }
  if (!same) {
    const std::string text = config::ReadWhole(config_path), patched = PatchNodes(text, config_path, nodes);
    config::ParseDaemon(patched, config_path);
    config::WriteWhole(config_path, patched);
    tell(fmt::format("\n{}\n{}", config_path, robot_file::DiffLines(text, patched)));
  }
  if (!zeros.empty()) {
    const std::string text = config::ReadWhole(robot_path);
    const robot_file::RobotPatch patch = robot_file::PatchRobot(text, robot_path, zeros, {});
    config::WriteWhole(robot_path, patch.text);
    tell(fmt::format("\n{}\n{}", robot_path, robot_file::DiffLines(text, patch.text)));
  }
  if (same && zeros.empty()) {
    throw std::runtime_error(
        "nothing is written: the disagreement is not in nodes, directions or cell zeros");
  }
}

}  // namespace tendril::commission
