#include "plant_options.h"

#include <fmt/core.h>

#include "seed_option.h"
#include "tendril/config/command_line.h"
#include "tendril/core/version.h"

namespace tendril::tools {

std::unique_ptr<CLI::App> MakePlantApp(PlantOptions& options) {
  auto app = std::make_unique<CLI::App>(
      "tendril-plant: emulated drives and a simulated robot on a CAN interface, in real time.\n"
      "Stands in for the rig: any CANopen master finds EPOS4 drives, or those of --drives, whose motors move "
      "the robot of the file.\n"
      "Exit status: 0 stopped by Ctrl-C or SIGTERM, 1 the work failed, 2 wrong use.",
      "tendril-plant");
  app->set_version_flag("--version", fmt::format("tendril-plant {} ({})", Version(), GitRevision()));
  app->add_option("--robot", options.robot,
                  "robot file with motors and drives, for example config/robots/rig_90mm.yaml")
      ->required();
  app->add_option(
      "--drives", options.drives,
      "daemon file whose bus.nodes say what each drive is (profile, eds); EPOS4 drives without it");
  app->add_option("--can", options.interface, "CAN interface")->capture_default_str();
  app->add_option(
      "--lcm", options.lcm_url,
      "LCM address, for example udpm://239.255.76.67:7667?ttl=0: publishes the tip on TENDRIL_TRACKER at the "
      "tracker's rate, if the robot has one, and takes faults on TENDRIL_FAULT; without it neither");
  app->add_option(
         "--fault", options.faults,
         "a fault to act out, may be repeated: a kind (drop, delay, duplicate, corrupt, die, reboot, "
         "freeze, emcy, stop_heartbeat, stick_sensor, sto, bus_off), then the keys of a scenario, for "
         "example \"drop node=2 probability=0.1 at_s=5 for_s=1\"")
      ->allow_extra_args(false);
  app->add_option("--scenario", options.scenario,
                  "file with faults, for example config/scenarios/rough_minute.yaml");
  app->add_option(
      "--extra-nodes", options.extra_nodes,
      "more drives beyond those of the robot file, for example 4-127: each turns a free motor like the "
      "robot's first one, and faults can be ordered for it like for any other");
  app->add_option("--seed", options.seed, "of the sensors' noise and of the faults' luck")
      ->check(Seed())
      ->capture_default_str();
  config::SettleCommandLine(*app);
  return app;
}

}  // namespace tendril::tools
