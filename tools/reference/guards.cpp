// The guards, from their table in the control room.
#include <fmt/format.h>

#include <sstream>

#include "markdown.h"
#include "reference.h"
#include "status_link.h"
#include "tendril/control/guard_table.h"

namespace tendril::reference {
namespace {

/// Robot and daemon file share no first name of a key.
std::string KeyLink(const std::string& key) {
  return Link(key.substr(key.rfind('.') + 1), key.starts_with("limits.") ? "robot-file.md" : "daemon-file.md",
              key);
}

std::string KeyLinks(std::string_view keys) {
  std::istringstream words{std::string(keys)};
  std::string links;
  for (std::string key; words >> key;) links += (links.empty() ? "" : "<br>") + KeyLink(key);
  return links.empty() ? "none" : links;
}

}  // namespace

Page GuardsPage() {
  std::string text =
      Head("Guards",
           "What is watched in every cycle. A fault latches: tensions ramp down, drives are disabled, and "
           "only `tendril send clear` ends it. `tendril config check` warns of a threshold that cannot "
           "trip on its robot.",
           {"src/control/modes/guard_table.cpp"});
  Table table({"What is wrong", "Status", "Thresholds"});
  for (const control::GuardEntry& guard : control::GuardTable()) {
    table.Row({Sentence(guard.what) +
                   Below(fmt::format("Judged {}; acts after {}.", Prose(control::WatchText(guard.watch)),
                                     Prose(guard.reaction))),
               StatusLink(guard.status), KeyLinks(guard.keys)});
  }
  return {"guards.md", text + table.Text()};
}

}  // namespace tendril::reference
