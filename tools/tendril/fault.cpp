// `tendril fault`: asks a running tendril-plant or tendril sim over LCM for a fault and shows its answer.
// Knows no drive.
#include <fmt/format.h>

#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <stdexcept>
#include <string>
#include <tendril_lcm/event_t.hpp>
#include <tendril_lcm/fault_t.hpp>
#include <vector>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "tendril/config/config.h"
#include "tendril/core/clock.h"
#include "tendril/io/connection.h"
#include "tendril/io/epoch.h"

namespace tendril::tools {
namespace {

struct FaultOptions {
  LcmOptions lcm;
  double timeout_s = 2;
  std::vector<std::string> words;
};

/// Takes the plant's answer to one order: its text distinguishes it from answers to others' orders.
class Answer {
 public:
  Answer(lcm::LCM& lcm, const std::string& prefix, const std::string& fault)
      : ordered_("fault ordered: " + fault.substr(0, 100)) {
    lcm.subscribe(io::ChannelName(prefix, "EVENT"), &Answer::OnEvent, this);
  }
  const std::string& text() const { return text_; }

 private:
  void OnEvent(const lcm::ReceiveBuffer*, const std::string&, const tendril_lcm::event_t* event) {
    const bool ours = event->source == "plant" &&
                      (event->text.starts_with(ordered_) || event->text.starts_with("fault refused"));
    if (text_.empty() && ours) text_ = event->text;
  }
  std::string ordered_;
  std::string text_;
};

void OrderFault(const FaultOptions& o) {
  const std::string fault = fmt::format("{}", fmt::join(o.words, " "));
  try {
    (void)config::ParseFault(fault, "fault");
  } catch (const config::ConfigError& e) {
    throw UsageError(e.what());
  }
  const auto lcm = io::OpenLcm(o.lcm.url);
  Answer answer(*lcm, o.lcm.prefix, fault);
  tendril_lcm::fault_t message{};
  message.utime = io::EpochUs();
  message.fault = fault;
  if (lcm->publish(io::ChannelName(o.lcm.prefix, "FAULT"), &message) != 0) {
    throw std::runtime_error("LCM could not send the fault on " + o.lcm.url);
  }
  if (o.timeout_s == 0) return;
  const MonotonicClock clock;
  const TimeNs end_ns = clock.Now() + static_cast<TimeNs>(o.timeout_s * static_cast<double>(kNsPerS));
  while (answer.text().empty() && clock.Now() < end_ns) io::HandleWaiting(*lcm, 20);
  if (answer.text().empty()) {
    throw std::runtime_error(fmt::format(
        "no tendril-plant or tendril sim answers on {} ({}_FAULT) within {:g} s; is it running, with the "
        "same --lcm (without --lcm tendril-plant takes no faults)?",
        o.lcm.url, o.lcm.prefix, o.timeout_s));
  }
  if (answer.text().starts_with("fault refused")) throw std::runtime_error(answer.text());
  fmt::print("{}\n", answer.text());
}

}  // namespace

void AddFaultCommand(CLI::App& app) {
  auto o = std::make_shared<FaultOptions>();
  CLI::App* fault = app.add_subcommand("fault",
                                       "Inject a fault into emulated drives or their bus, of a running "
                                       "tendril-plant or tendril sim; never into "
                                       "real ones");
  fault->footer(
      "Kinds and their keys, times in s from now, without for_s to the end:\n  drop, duplicate, corrupt    "
      "frames  [node= direction=to_drives|from_drives cob_id= probability= count= for_s=]\n  delay delay_s=  "
      "            frames, with the same keys\n  die node= [for_s=]          no supply\n  freeze node= "
      "[for_s=]       no communication, its torque stays\n  reboot node=                off and on\n  "
      "stop_heartbeat node=        until it is reset\n  emcy node= code=            the error behind a "
      "code\n  stick_sensor node= sensor=encoder|load_cell|torque [for_s=]\n  sto [node= for_s=]          "
      "safe torque off; without node, of every drive\n  bus_off [for_s=]\nand at_s= with each, for example: "
      "tendril fault emcy node=2 code=0x7320 at_s=1\ntendril-plant accepts them when started with --lcm. "
      "Exit status: 0 accepted, 1 refused or no answer, 2 wrong use.");
  AddLcmOptions(*fault, o->lcm);
  fault->add_option("--timeout", o->timeout_s, "how long to wait for the plant's answer [s]; 0: not at all")
      ->capture_default_str()
      ->check(NumberFrom(0, 3600, "give seconds"));
  fault->add_option("fault", o->words, "a kind, then key=value")
      ->required()
      ->option_text("KIND KEY=VALUE ...");
  fault->callback([o] { OrderFault(*o); });
}

}  // namespace tendril::tools
