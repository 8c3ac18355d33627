// tendril capstan: the tension on the other side of a guide pulley, from the command line.
// Knows the transmission's law only; the low-tension continuation of a robot's table is an option.
#include "tendril/model/capstan.h"

#include <fmt/core.h>

#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "commands.h"
#include "number_option.h"

namespace tendril::tools {
namespace {

struct Options {
  PulleyParameters pulley;
  double tension_base_N = 0;
  double low_tension_N = 0;
  bool release = false;
  CLI::Option* exponent = nullptr;
  CLI::Option* radius_ratio = nullptr;
};

void Run(const Options& o) {
  if (o.pulley.law != CapstanLaw::kClassic && !(*o.exponent && *o.radius_ratio)) {
    throw UsageError("capstan: --n and --rho are required (only --law classic needs neither)");
  }
  try {
    model::ValidatePulley(o.pulley);
  } catch (const std::invalid_argument& e) {
    throw UsageError(fmt::format("capstan: {}", e.what()));
  }
  const double ratio = model::CapstanRatio(o.pulley, o.tension_base_N, o.release, o.low_tension_N);
  nlohmann::ordered_json answer;
  answer["ratio"] = ratio;
  answer["tension_motor_N"] = ratio * o.tension_base_N;
  answer["tension_base_N"] = o.tension_base_N;
  fmt::print("{}\n", answer.dump(2));
}

}  // namespace

void AddCapstanCommand(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("capstan", "Tendon friction over a guide pulley: JSON with the tensions");
  command->footer(
      "Prints ratio (motor side over robot side), tension_motor_N and tension_base_N. The plain equation, "
      "without\nthe constant ratio that a robot's table uses below transmission.low_tension_N (--low-tension "
      "adds it). At zero\ntension the ratio is the limit. Without friction (alpha 0) and with no wrap the "
      "ratio is 1, except for the factor\ncos(phi1) of the improved law; the classic law has no phi1.");
  Options& o = *options;
  // A wrong value is reported before a missing one.
  command->add_option("--alpha", o.pulley.alpha, "friction coefficient [N^(1-n)], 0 .. 100")
      ->required()
      ->check(NumberFrom(0, 100, "give a coefficient, 0 for no friction"));
  o.exponent = command->add_option("--n", o.pulley.exponent, "friction exponent, 0.05 .. 1")
                   ->check(NumberFrom(0.05, 1, "1 is the classic law's"));
  o.radius_ratio =
      command->add_option("--rho", o.pulley.radius_ratio, "pulley radius over tendon radius, up to 1e12")
          ->check(NumberFrom(std::numeric_limits<double>::min(), 1e12, "give the ratio of the radii"));
  command->add_option("--wrap", o.pulley.wrap_rad, "wrap angle [rad], 0 .. 100")
      ->required()
      ->check(NumberFrom(0, 100, "give radians"));
  command->add_option("--tension", o.tension_base_N, "tension on the robot's side [N], 0 .. 1e6")
      ->required()
      ->check(NumberFrom(0, model::kMaxCapstanTension_N, "give newtons"));
  command->add_option("--phi1", o.pulley.entry_angle_rad, "entry angle [rad], 0 .. 1.5")
      ->check(NumberFrom(0, 1.5, "give radians"))
      ->capture_default_str();
  command
      ->add_option_function<std::string>(
          "--direction", [options](const std::string& text) { options->release = text == "release"; },
          "the motor's motion: pull (default) or release")
      ->check(CLI::IsMember({"pull", "release"}));
  command
      ->add_option_function<std::string>(
          "--law",
          [options](const std::string& text) {
            options->pulley.law = text == "classic" ? CapstanLaw::kClassic
                                  : text == "local" ? CapstanLaw::kLocal
                                                    : CapstanLaw::kCumulative;
          },
          "cumulative (default), local or classic")
      ->check(CLI::IsMember({"cumulative", "local", "classic"}));
  command
      ->add_option("--low-tension", o.low_tension_N,
                   "below this low-side tension [N] keep the ratio found there")
      ->check(NumberFrom(0, model::kMaxCapstanTension_N, "give newtons"))
      ->capture_default_str();
  command->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
