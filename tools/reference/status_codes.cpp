// Status codes with their remedies, from core/status.h.
#include <fmt/format.h>

#include "markdown.h"
#include "reference.h"
#include "status_link.h"
#include "tendril/core/status.h"

namespace tendril::reference {

int NumberOf(Status status) { return static_cast<int>(status); }

std::string StatusLink(Status status) {
  const std::string number = std::to_string(NumberOf(status));
  return Link(number, "status-codes.md", number);
}

Page StatusCodesPage() {
  std::string text =
      Head("Status codes",
           "What the control loop reports: in messages, in the log and in `tendril status`. A number keeps "
           "its meaning for ever.",
           {"include/tendril/core/status.h"});
  for (const StatusBlock& block : StatusBlocks()) {
    text += Heading(2, fmt::format("{} .. {}: {}", block.first, block.first + 99, block.title), block.title);
    text += Prose(block.meaning) + "\n\n";
    Table table({"Status", "What happened, and what to do"});
    for (int number = block.first; number < block.first + 100; ++number) {
      for (const StatusEntry& entry : Statuses()) {
        if (NumberOf(entry.status) != number) continue;
        const std::string_view remedy = StatusRemedy(entry.status);
        table.Row({Target(std::to_string(number), std::to_string(number)) + Below(Escaped(entry.name)),
                   Sentence(StatusText(entry.status)) + (remedy.empty() ? "" : "<br>→ " + Sentence(remedy))});
      }
    }
    text += table.Text();
  }
  return {"status-codes.md", text};
}

}  // namespace tendril::reference
