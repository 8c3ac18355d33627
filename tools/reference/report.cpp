// The fields of report.json, from the list that its writer walks; what they mean, from the comments of the
// structures.
#include "tendril/gap/report.h"

#include <fmt/format.h>

#include <algorithm>

#include "declarations.h"
#include "markdown.h"
#include "reference.h"

namespace tendril::reference {
namespace {

/// "location" of "location[].rms": the part of the report that a field belongs to.
std::string PartOf(const std::string& path) { return path.substr(0, path.find_first_of(".[")); }

std::string PartsTable(const std::vector<gap::ReportField>& fields, const std::string& part,
                       const std::vector<Structure>& structures) {
  Table table({"Field", "Meaning"});
  for (const gap::ReportField& field : fields) {
    if (PartOf(field.path) != part) continue;
    const std::string meaning = field.member.empty() ? field.meaning : CommentOf(structures, field.member);
    table.Row({Target(field.path, field.path), Prose(meaning) + Below(Prose(field.type))});
  }
  return table.Text();
}

}  // namespace

Page ReportPage(const std::filesystem::path& source) {
  const auto structures = ReadDeclarations(source / "include/tendril/gap/diagnosis.h");
  const auto fields = gap::ReportFields();
  std::string text = Head("Report of the diagnosis",
                          "`tendril gap diagnose` writes `report.json`, which holds every number of the page "
                          "`report.html`. Numbers are in SI units; one that is not finite is null.",
                          {"include/tendril/gap/diagnosis.h", "src/gap/report_fields.h"});
  std::vector<std::string> parts;
  for (const gap::ReportField& field : fields) {
    if (std::find(parts.begin(), parts.end(), PartOf(field.path)) == parts.end())
      parts.push_back(PartOf(field.path));
  }
  for (const std::string& part : parts)
    text += Heading(2, Code(part), "part-" + part) + PartsTable(fields, part, structures);
  return {"report-json.md", text};
}

}  // namespace tendril::reference
