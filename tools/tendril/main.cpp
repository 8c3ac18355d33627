// tendril: one command for everything a person does with the robot, its model and its logs.
#include <fmt/core.h>

#include "commands.h"
#include "tendril/core/version.h"

int main(int argc, char** argv) {
  CLI::App app{"Tendril: run, simulate and compute tendon-driven continuum robots"};
  app.set_version_flag("--version",
                       fmt::format("tendril {} ({})", tendril::Version(), tendril::GitRevision()));
  app.require_subcommand(1);
  tendril::tools::AddCapstanCommand(app);
  tendril::tools::AddConfigCommand(app);
  tendril::tools::AddDemoCommand(app);
  tendril::tools::AddFollowCommand(app);
  tendril::tools::AddModelCommand(app);
  tendril::tools::AddReproduceCommand(app);
  tendril::tools::AddSendCommand(app);
  tendril::tools::AddStatusCommand(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const tendril::tools::UsageError& e) {
    fmt::print(stderr, "tendril: {}\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "tendril: {}\n", e.what());
    return 1;
  }
  return 0;
}
