// `tendril home`: tells a daemon to take up the tendons' slack and waits for how it ends. Knows nothing of
// the robot: the daemon does the homing.
#include <fmt/format.h>

#include <memory>
#include <stdexcept>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "stop_signals.h"
#include "tendril/core/clock.h"
#include "tendril/core/status.h"
#include "tendril/io/client.h"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/state_t.hpp"

namespace tendril::tools {
namespace {

struct HomeOptions {
  LcmOptions lcm;
  double timeout_s = 120;
};

// Sequence number of the request.
std::int64_t Request(io::Client& client, ModeRequest mode, const std::string& url) {
  Command command;
  command.kind = CommandKind::kMode;
  command.mode = mode;
  command.valid_for_ns = kNsPerS;
  return io::Publish(client, command, url);
}

void Home(const HomeOptions& o) {
  const std::atomic<bool>& stop = CatchStopSignals();
  io::Client client(o.lcm.url, o.lcm.prefix);
  std::int64_t sequence = 0;
  bool heard = false, seen = false;
  tendril_lcm::state_t state{};
  std::string last_fault;
  client.OnState([&](const tendril_lcm::state_t& s) {
    heard = true;
    seen = seen || s.command_sequence == sequence;
    state = s;
  });
  client.OnEvent([&](const tendril_lcm::event_t& e) {
    if (e.source == "controller" && e.status != 0) last_fault = e.text;
  });
  sequence = Request(client, ModeRequest::kHome, o.lcm.url);
  const MonotonicClock clock;
  const TimeNs asked_ns = clock.Now(), end_ns = asked_ns + static_cast<TimeNs>(o.timeout_s * 1e9);
  const double answer_s = std::min(2.0, o.timeout_s);
  const TimeNs answer_ns = static_cast<TimeNs>(answer_s * static_cast<double>(kNsPerS));
  while (!seen && clock.Now() < asked_ns + answer_ns) client.Handle(20);
  if (!heard) throw std::runtime_error(NobodyAnswers(o.lcm, answer_s, client));
  if (!seen && !client.ignored().empty())
    throw std::runtime_error("the daemon did not take the command: " + client.ignored());
  if (!seen) {
    throw std::runtime_error(fmt::format(
        "the daemon is running but did not receive the command within {:g} s; try again", answer_s));
  }
  if (state.command_status != 0) {
    throw std::runtime_error(
        fmt::format("{} ({}, mode {})", state.command_status_text, state.command_status, state.mode_text));
  }
  while (state.mode == tendril_lcm::state_t::MODE_HOMING && clock.Now() < end_ns && !stop) client.Handle(20);
  if (state.mode == tendril_lcm::state_t::MODE_HOMING) {
    // Nothing is wound in when nobody watches.
    Request(client, ModeRequest::kDisarm, o.lcm.url);
    for (const TimeNs until_ns = clock.Now() + 3 * kNsPerS;
         state.mode != tendril_lcm::state_t::MODE_CONFIGURED && clock.Now() < until_ns;)
      client.Handle(20);
    throw std::runtime_error(
        fmt::format("{}: the daemon was asked to disarm; it is in mode {}",
                    stop ? "stopped" : fmt::format("not homed within {:g} s", o.timeout_s), state.mode_text));
  }
  if (state.mode == tendril_lcm::state_t::MODE_FAULT) {
    // The event names the tendon; it comes with the state.
    for (int i = 0; i < 20 && last_fault.empty(); ++i) client.Handle(20);
    throw std::runtime_error(fmt::format("{}; {}", last_fault.empty() ? state.status_text : last_fault,
                                         StatusRemedy(static_cast<Status>(state.status))));
  }
  if (state.mode != tendril_lcm::state_t::MODE_HOLD) {
    throw std::runtime_error(fmt::format("homing was aborted: mode {}", state.mode_text));
  }
  fmt::print("homed in {:.1f} s; tensions now", ToSeconds(clock.Now() - asked_ns));
  for (const double tension_N : state.tension_measured_N) fmt::print(" {:.2f}", tension_N);
  fmt::print(
      " N, displacement counts from here; the robot holds: `tendril send arm` lets it follow commands\n");
}

}  // namespace

void AddHomeCommand(CLI::App& app) {
  auto o = std::make_shared<HomeOptions>();
  CLI::App* home = app.add_subcommand(
      "home", "Wind in the tendons' slack gently, pretension, and set displacement to zero; then hold");
  AddOperatorOptions(*home, o->lcm);
  home->add_option("--timeout", o->timeout_s, "how long to wait for the end [s]")
      ->capture_default_str()
      ->check(NumberFrom(1, 3600, "give seconds"));
  home->callback([o] { Home(*o); });
}

}  // namespace tendril::tools
