// The controller's modes, from the supervisor's table and the command gate.
#include <fmt/format.h>

#include "markdown.h"
#include "reference.h"
#include "tendril/control/gate.h"
#include "tendril/control/supervisor.h"

namespace tendril::reference {
namespace {

struct NamedCommand {
  const char* name;
  CommandKind kind;
  ModeRequest request = ModeRequest::kHold;
};
constexpr NamedCommand kCommands[] = {
    {"tip", CommandKind::kTip},
    {"bending", CommandKind::kBending},
    {"tension", CommandKind::kTension},
    {"arm", CommandKind::kMode, ModeRequest::kArm},
    {"disarm", CommandKind::kMode, ModeRequest::kDisarm},
    {"hold", CommandKind::kMode, ModeRequest::kHold},
    {"clear", CommandKind::kMode, ModeRequest::kClear},
    {"commission", CommandKind::kMode, ModeRequest::kCommission},
    {"home", CommandKind::kMode, ModeRequest::kHome},
};

std::string ModeLink(Mode mode) { return fmt::format("[{}](#{})", ModeText(mode), Anchor(ModeText(mode))); }

std::string Accepted(Mode mode) {
  std::string names;
  for (const NamedCommand& named : kCommands) {
    Command command;
    command.kind = named.kind;
    command.mode = named.request;
    if (control::CommandGate::AcceptedIn(mode, command))
      names += (names.empty() ? "" : ", ") + Code(named.name);
  }
  return names.empty() ? "none" : names;
}

std::string Leaves(Mode mode) {
  Table table({"When", "Next mode"});
  for (const control::Transition& t : control::Supervisor::Table()) {
    if (t.from == mode) table.Row({Prose(control::EventText(t.event)), ModeLink(t.to)});
  }
  return table.Text();
}

}  // namespace

Page ModesPage() {
  std::string text =
      Head("Modes",
           "Nothing moves without `arm`, `home` or `commission`, and nothing resumes by itself after a "
           "fault. A command that the mode does not accept is refused with status "
           "[204](status-codes.md#204) and changes nothing.",
           {"src/control/modes/supervisor.cpp", "src/control/modes/gate.cpp", "src/core/cycle.cpp"});
  Table overview({"Mode", "Meaning"});
  std::string each;
  for (int i = 0; i <= static_cast<int>(kLastMode); ++i) {
    const auto mode = static_cast<Mode>(i);
    overview.Row({ModeLink(mode) + Below(fmt::format("{} in messages", i)), Prose(ModeMeaning(mode))});
    each += Heading(2, ModeText(mode), ModeText(mode)) + Prose(ModeMeaning(mode)) +
            "\n\nAccepts: " + Accepted(mode) + ".\n\n" + Leaves(mode);
  }
  return {"modes.md", text + overview.Text() + each};
}

}  // namespace tendril::reference
