// The paper's claims that a simulation can check, as a table, and what is found for each. Knows no physics.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace tendril::qi2021 {

struct Claim {
  std::string_view id;       // stable, for other programs
  std::string_view section;  // of the paper
  std::string_view figure;   // or equation; may be empty
  std::string_view what;     // a few words for the table
  std::string_view says;     // the claim in one sentence
  std::string_view paper;    // its value as people read it
  std::optional<double> paper_value;
  std::string_view unit;
  std::string_view plot;  // name of the page's plot that shows it; may be empty
};

/// In the order in which they are shown.
std::span<const Claim> Claims();
/// Throws std::logic_error for an id that the table does not have.
const Claim& ClaimNamed(std::string_view id);

enum class Verdict {
  kConfirmed,    // holds as printed
  kDiffers,      // ours is another value, or holds only in part
  kNotAsStated,  // what the paper states is not enough, or not what its equations say
};

struct Finding {
  std::string ours;  // our value as people read it
  std::optional<double> our_value;
  Verdict verdict = Verdict::kDiffers;
  std::string reason;
  // One object a reading of what the paper leaves open: {"upright, 90 mm": {"mean_rad": 0.51, ...}, ...}
  nlohmann::ordered_json readings = nlohmann::ordered_json::object();
};

struct JudgedClaim {
  Claim claim;
  Finding finding;
};

}  // namespace tendril::qi2021
