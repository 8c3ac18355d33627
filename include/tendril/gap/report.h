// The report of a diagnosis: an HTML page, a JSON file with every number of the page, and a summary for the
// terminal. Knows nothing of how the diagnosis was made.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// The diagnosis as the report shows it: causes by falling p, with "no_gap" and "unknown"; curves rounded to
/// six digits and thinned, keeping their extremes. Idempotent.
Diagnosis Condensed(const Diagnosis& diagnosis);

/// The condensed diagnosis as JSON text; numbers that are not finite become null. Equal diagnoses give equal
/// text except for provenance.seconds.
std::string ReportJson(const Diagnosis& diagnosis);
/// The inverse: ReportJson(ParseReport(t)) == t for every t made by ReportJson; null becomes NaN. Throws
/// std::runtime_error naming the key that is missing or wrong.
Diagnosis ParseReport(const std::string& json);

/// A field of report.json, for the generated reference.
struct ReportField {
  std::string path;     // "location[].rms"
  std::string type;     // "number or null"
  std::string member;   // "CutFinding::rms", whose comment in diagnosis.h is its description; if empty,
  std::string meaning;  // this is its description
};
std::vector<ReportField> ReportFields();

/// One self-contained HTML page that needs no network.
std::string ReportPage(const Diagnosis& diagnosis);
/// The style sheet of its page, for other pages.
std::string ReportStyle();

/// Writes report.json and report.html into the folder, creating it. Throws std::runtime_error when they
/// cannot be written.
void WriteReport(const Diagnosis& diagnosis, const std::filesystem::path& folder);
/// Throws std::runtime_error with the file's name and the error in it.
Diagnosis ReadReport(const std::filesystem::path& file);

/// Text for the terminal, at most 100 columns: sentence, chain, causes, closure, next step, and the report's
/// path unless empty. `colour` adds terminal colour codes.
std::string Summary(const Diagnosis& diagnosis, const std::filesystem::path& report = {},
                    bool colour = false);

/// The words of a text in lines of at most 100 columns, indented by `indent` blanks; control characters
/// become blanks.
std::string Wrapped(std::string_view text, int indent);

/// Names of a cut and of the signals on both sides of it.
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
