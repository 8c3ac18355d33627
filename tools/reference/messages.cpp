// The LCM messages, from the .lcm files and their comments.
#include <fmt/format.h>

#include <algorithm>

#include "declarations.h"
#include "markdown.h"
#include "reference.h"

namespace tendril::reference {
namespace {

std::string TypeText(const Member& member) {
  return member.extent.empty() ? member.type : fmt::format("{}[{}]", member.type, member.extent);
}

/// "---- input ----" is a heading, anything else a sentence.
std::string GroupText(std::string group) {
  const auto is_rule = [](char c) { return c == '-' || c == ' '; };
  if (!group.starts_with("--")) return Prose(group);
  while (!group.empty() && is_rule(group.back())) group.pop_back();
  while (!group.empty() && is_rule(group.front())) group.erase(group.begin());
  return fmt::format("**{}**", Prose(group));
}

std::string Constants(const Structure& message) {
  Table table({"Constant", "Value", "Meaning"});
  for (const Member& m : message.members) {
    if (m.constant) table.Row({Target(m.name, message.name + "." + m.name), m.value, Prose(m.comment)});
  }
  return table.empty() ? "" : table.Text();
}

std::string Fields(const Structure& message) {
  std::string text, group;
  Table table({"Field", "Meaning"});
  for (const Member& m : message.members) {
    if (m.constant) continue;
    if (m.group != group && !m.group.empty()) {
      if (!table.empty()) text += table.Text();
      text += GroupText(m.group) + "\n\n";
      table = Table({"Field", "Meaning"});
    }
    group = m.group;
    table.Row({Target(m.name, message.name + "." + m.name) + Below(Escaped(TypeText(m))), Prose(m.comment)});
  }
  return text + (table.empty() ? "" : table.Text());
}

}  // namespace

Page MessagesPage(const std::filesystem::path& source) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(source / "lcm_types")) {
    if (entry.path().extension() == ".lcm") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::string text =
      Head("LCM messages",
           "Channels are named PREFIX_NAME, with PREFIX the daemon file's "
           "[`lcm.channel_prefix`](daemon-file.md#lcm.channel_prefix), `TENDRIL` as shipped. Units stand "
           "in brackets and at the end of names.",
           {"lcm_types/*.lcm"});
  for (const auto& file : files) {
    for (const Structure& message : ReadDeclarations(file)) {
      text += Heading(2, Code(message.name), message.name) + Prose(message.comment) + "\n\n";
      text += Constants(message) + Fields(message);
    }
  }
  return {"messages.md", text};
}

}  // namespace tendril::reference
