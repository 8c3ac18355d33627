// The report of a diagnosis: a page to look at, a JSON file with every number of the page, and a few lines
// for the terminal. Knows nothing of how the diagnosis was made.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// What the report is made of: causes by falling p, with "no_gap" and "unknown"; curves with six digits and
/// thinned so that the page stays small, a thinned curve keeping its extremes. Done twice it changes nothing
/// more.
Diagnosis Condensed(const Diagnosis& diagnosis);

/// Every number of the condensed diagnosis as JSON text; a number that is not finite becomes null. The same
/// diagnosis gives the same text but for provenance.seconds.
std::string ReportJson(const Diagnosis& diagnosis);
/// The inverse: ReportJson(ParseReport(t)) == t for every t that ReportJson made; null becomes NaN. Throws
/// std::runtime_error naming the key that is missing or wrong.
Diagnosis ParseReport(const std::string& json);

/// A field of report.json, for the reference.
struct ReportField {
  std::string path;     // "location[].rms"
  std::string type;     // "number or null"
  std::string member;   // "CutFinding::rms", whose comment in diagnosis.h says what it is; or empty, and then
  std::string meaning;  // says it
};
std::vector<ReportField> ReportFields();

/// One HTML page that needs no other file and no network.
std::string ReportPage(const Diagnosis& diagnosis);

/// report.json and report.html into the folder, which is created. Throws std::runtime_error when they cannot
/// be written.
void WriteReport(const Diagnosis& diagnosis, const std::filesystem::path& folder);
/// Throws std::runtime_error with the file's name and what is wrong in it.
Diagnosis ReadReport(const std::filesystem::path& file);

/// For the terminal, at most 100 columns: sentence, chain, causes, what closed, what next, where the report
/// is (left out when empty). `colour` adds terminal colour codes.
std::string Summary(const Diagnosis& diagnosis, const std::filesystem::path& report = {},
                    bool colour = false);

/// The words of a text in lines of at most 100 columns, `indent` of them blank; control characters become
/// blanks.
std::string Wrapped(std::string_view text, int indent);

/// What a cut compares, for people.
struct CutText {
  const char* title;  // "drivetrain"
  const char* from;   // "motor torque"
  const char* to;     // "load cell"
};
const CutText& TextOf(sim::Cut cut);

/// "mass_kg" -> "mass" and "kg"; "rad" -> "" and "rad"; "scale" -> "scale" and "".
struct ParameterText {
  std::string word, unit;
};
ParameterText TextOf(std::string_view parameter);

}  // namespace tendril::gap
