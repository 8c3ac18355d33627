#include "tendril/commission/session.h"

#include <fmt/format.h>

#include <stdexcept>
#include <utility>

#include "tendril/commission/findings_file.h"
#include "tendril/commission/live_link.h"
#include "tendril/commission/same_files.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/core/usage_error.h"

namespace tendril::commission {
namespace {

struct Subject {
  DaemonParameters daemon;
  RobotParameters robot;
};

Subject Checked(const SessionCall& call) {
  Subject subject;
  subject.daemon = config::LoadDaemon(call.config);
  subject.robot = config::LoadRobot(subject.daemon.robot_file);
  config::CheckTogether(subject.daemon, subject.robot, call.config);
  RequireRecordAsked(subject.daemon, call.config);
  const auto motors = static_cast<std::size_t>(subject.robot.actuation->drives());
  if (!call.seen_rad.empty() && call.seen_rad.size() != motors) {
    const bool pairs = !subject.robot.actuation->pairs.empty();
    throw UsageError(fmt::format("--seen needs a direction for each of the {} {}, {} given", motors,
                                 pairs ? "motors, where its first tendon pulls" : "tendons",
                                 call.seen_rad.size()));
  }
  // Before motors pull for half a minute, not after.
  config::CheckMayWrite(daemon::RecordPath(subject.daemon));
  if (call.write) {
    config::CheckMayWrite(call.config);
    config::CheckMayWrite(subject.daemon.robot_file);
  }
  return subject;
}

/// Disarmed again when it returns.
std::pair<CommissionResult, DriveSerials> Pull(const SessionCall& call, const Subject& subject,
                                               const Operator& person) {
  const auto& [daemon, robot] = subject;
  LiveLink link(call.lcm_url.empty() ? daemon.lcm.url : call.lcm_url,
                call.channel_prefix.empty() ? daemon.lcm.channel_prefix : call.channel_prefix, call.stop);
  RequireSameFiles({link.Robot(), link.Daemon()}, {robot, daemon}, call.config);
  person.consent(daemon.controller.take_up.pull_N);
  link.Enter(robot.body.tendons());
  const AskDirection direction = [&](int tendon, const std::function<void()>& keep_going) {
    if (call.seen_rad.empty()) return person.direction(tendon, keep_going);
    return std::optional(call.seen_rad[static_cast<std::size_t>(robot.actuation->DriveOf(tendon - 1))]);
  };
  CommissionResult result = Commission(link, robot, daemon, direction, person.progress);
  return {std::move(result), link.serials()};
}

}  // namespace

std::string RunSession(const SessionCall& call, const Operator& person) {
  const Subject subject = Checked(call);
  const auto [result, serials] = Pull(call, subject, person);
  person.tell("\n" + CommissionTable(result));
  if (!result.passed()) {
    if (!call.write) {
      throw std::runtime_error(
          "not commissioned: correct the problems above (or let --write change the files where that is "
          "enough), and commission again");
    }
    WriteFindings(result, call.config, subject.daemon.robot_file, person.tell);
    person.tell(
        "\nwritten; restart tendrild, which reads its files once, and commission again: nothing is armed "
        "before that passes\n");
    throw std::runtime_error("not commissioned yet");
  }
  const std::string path = daemon::RecordPath(subject.daemon);
  daemon::WriteRecord(path, RecordOf(result, subject.robot, subject.daemon, serials));
  return path;
}

}  // namespace tendril::commission
