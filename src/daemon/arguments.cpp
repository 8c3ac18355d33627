#include "arguments.h"

#include <fmt/format.h>

#include "tendril/config/command_line.h"
#include "tendril/core/version.h"

namespace tendril::daemon {

std::unique_ptr<CLI::App> MakeApp(Arguments& arguments) {
  auto app = std::make_unique<CLI::App>(
      "tendrild: controls a tendon-driven continuum robot over CANopen, commanded over LCM (tendril send, "
      "tendril status).\n"
      "Stops on SIGINT or SIGTERM: ramps the tensions down, disables the drives and exits within 2 s.",
      "tendrild");
  app->set_version_flag("--version", fmt::format("tendrild {} ({})", Version(), GitRevision()));
  app->add_option("--config", arguments.config, "daemon file, for example config/tendrild.yaml")
      ->required()
      ->option_text("FILE");
  app->add_option("--can", arguments.can, "CAN interface instead of the file's bus.interface")
      ->option_text("IFACE");
  app->add_option("--lcm", arguments.lcm, "LCM address instead of the file's lcm.url")->option_text("URL");
  app->add_option("--log", arguments.log,
                  "write an LCM log of everything (replay, gap diagnosis); an earlier one becomes FILE.1, "
                  "FILE.2 ...")
      ->option_text("FILE");
  app->add_option("--black-box", arguments.black_box,
                  "folder for the cycles before a fault instead of the file's black_box.folder")
      ->option_text("FOLDER");
  app->add_flag("--simulated", arguments.simulated,
                "arm a robot that was never commissioned: for a simulation behind the bus only");
  app->add_flag(
      "--wait", arguments.wait,
      "wait for the CAN interface and a route for LCM instead of ending without them: for a service");
  app->footer("Exit status: 0 stopped on request, 1 could not run, 2 wrong use.");
  config::SettleCommandLine(*app);
  return app;
}

}  // namespace tendril::daemon
