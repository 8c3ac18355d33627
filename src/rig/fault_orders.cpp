// Fault orders from text, and the errors of those that do not fit. Knows no bus.
#include "tendril/rig/fault_orders.h"

#include <fmt/core.h>

#include <stdexcept>
#include <string_view>
#include <tendril_lcm/event_t.hpp>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/core/plain_text.h"
#include "tendril/io/connection.h"
#include "tendril/io/wire.h"

namespace tendril::rig {
namespace {

std::string Shown(std::string_view text) { return PlainText(text, 120); }

}  // namespace

std::vector<FaultOrder> ReadFaults(const std::vector<std::string>& texts) {
  std::vector<FaultOrder> orders;
  for (const std::string& text : texts) orders.push_back({"--fault", config::ParseFault(text, "--fault")});
  return orders;
}

std::vector<FaultOrder> ReadScenario(const std::string& path) {
  std::vector<FaultOrder> orders;
  for (const FaultParameters& fault : config::LoadScenario(path)) {
    orders.push_back({fmt::format("{}: faults[{}]", path, orders.size() + 1), fault});
  }
  return orders;
}

void Order(const std::vector<FaultOrder>& orders, emulator::FaultInjector& faults, TimeNs now_ns) {
  for (const FaultOrder& order : orders) {
    try {
      faults.Add(order.fault, now_ns);
    } catch (const std::invalid_argument& e) {
      throw config::ConfigError(fmt::format("{}: {}", order.where, e.what()));
    }
  }
}

FaultListener::FaultListener(lcm::LCM& lcm, const std::string& prefix, emulator::FaultInjector& faults,
                             const Clock& clock)
    : lcm_(lcm),
      event_channel_(io::ChannelName(prefix, "EVENT")),
      faults_(faults),
      clock_(clock),
      subscription_(lcm.subscribe(io::ChannelName(prefix, "FAULT"), &FaultListener::OnFault, this)) {}

FaultListener::~FaultListener() { lcm_.unsubscribe(subscription_); }

std::vector<std::string> FaultListener::TakeLines() { return std::exchange(lines_, {}); }

void FaultListener::OnFault(const lcm::ReceiveBuffer*, const std::string& channel,
                            const tendril_lcm::fault_t* message) {
  try {
    Order({{channel, config::ParseFault(message->fault, channel)}}, faults_, clock_.Now());
    ++ordered_;
    Answer(fmt::format("fault ordered: {}", Shown(message->fault)));
  } catch (const config::ConfigError& e) {
    Answer(fmt::format("fault refused: {}", e.what()));
  }
}

void FaultListener::Answer(const std::string& line) {
  tendril_lcm::event_t event{};
  event.utime = clock_.Now() / kNsPerUs + io::EpochOffsetUs(clock_);
  event.source = "plant";
  event.text = line;
  lcm_.publish(event_channel_, &event);
  lines_.push_back(line);
}

}  // namespace tendril::rig
