// tendril replay: is the controller in a log the one in this program, to the last bit? Knows nothing of how
// logs are written.
#include <fmt/core.h>

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "commands.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/experiment/log_replay.h"

namespace tendril::tools {
namespace {

struct Options {
  std::string log, robot, config;
};

void Run(const Options& o) {
  std::optional<RobotParameters> robot;
  std::optional<DaemonParameters> parameters;
  if (!o.robot.empty()) robot = config::LoadRobot(o.robot);
  if (!o.config.empty()) parameters = config::LoadDaemon(o.config);
  const experiment::ReplayResult r = experiment::ReplayLog(o.log, robot, parameters);

  if (r.git_revision != GitRevision()) {
    fmt::print("log written by {} ({}), this is {} ({})\n", r.version, r.git_revision, Version(),
               GitRevision());
  }
  fmt::print("{} cycles replayed, {} to {}{}\n", r.replayed, r.first_cycle, r.last_cycle,
             r.from_snapshot ? ", from the controller's state in the log" : "");
  if (r.difference) {
    const experiment::Difference& d = *r.difference;
    fmt::print("first difference: cycle {} at {:.6f} s, {}, bit {}\n  logged   {}\n  replayed {}\n", d.cycle,
               ToSeconds(d.time_ns), d.field, d.bit, d.logged, d.replayed);
    const std::string damage = r.damage.empty() ? "" : "; the log is damaged: " + r.damage;
    if (d.agree > 0) {
      throw std::runtime_error(
          fmt::format("{}: one cycle differs and the {} after it are identical to the last bit, as when its "
                      "event, at byte {}, is damaged{}",
                      o.log, d.agree, d.offset, damage));
    }
    if (d.readings_agree > 0) {
      throw std::runtime_error(
          fmt::format("{}: one cycle's readings are not what the log says of it and those of the {} after it "
                      "are, as when its event, at byte {}, is damaged; what follows from them differs{}",
                      o.log, d.readings_agree, d.offset, damage));
    }
    throw std::runtime_error(
        fmt::format("{}: this controller does not reproduce the log, from the event at byte {} on{}", o.log,
                    d.offset, damage));
  }
  std::string rest;
  if (r.unchecked > 0) {
    const experiment::MissingCycles& m = r.missing;
    rest = fmt::format("{} before the event at byte {}; the {} cycles from there could not be checked",
                       m.found < m.cycle ? fmt::format("cycles begin again after cycle {}", m.cycle - 1)
                                         : fmt::format("cycle {} is missing", m.cycle),
                       m.offset, r.unchecked);
  }
  if (!r.damage.empty()) rest += (rest.empty() ? "damaged: " : "; damaged: ") + r.damage;
  if (!rest.empty()) {
    throw std::runtime_error(
        fmt::format("{}: incomplete: no bit differs in {} cycles; {}", o.log, r.replayed, rest));
  }
  fmt::print("no bit differs\n");
}

}  // namespace

void AddReplayCommand(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "replay", "Run the controller again on a log's inputs and find the first bit that differs");
  sub->add_option("FILE", options->log, "log of the demo or the daemon, or a black box")->required();
  sub->add_option("--robot", options->robot, "robot file instead of the log's")->option_text("FILE");
  sub->add_option("--config", options->config, "daemon file instead of the log's")->option_text("FILE");
  sub->footer("Exit status: 0 no bit differs, 1 a bit differs or not all could be checked, 2 wrong use.");
  sub->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
