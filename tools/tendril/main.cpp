// tendril: one command for everything a person does with the robot, its model and its logs.
#include <fmt/core.h>

#include "commands.h"

int main(int argc, char** argv) {
  CLI::App app{"Tendril: controller, simulator and gap diagnosis for tendon-driven continuum robots"};
  app.require_subcommand(1);
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
