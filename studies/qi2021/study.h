// What `tendril reproduce` collects: the paper's claims with its value beside ours, and the series behind
// them. Knows no physics.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tendril/io/csv.h"

namespace tendril::tools::reproduce {

enum class Verdict {
  kConfirmed,    // holds as printed
  kDiffers,      // ours is another value, or holds only in part
  kNotAsStated,  // what the paper states is not enough, or not what its equations say
};

struct Claim {
  std::string id;           // stable, for other programs
  std::string section;      // of the paper
  std::string figure;       // or equation; may be empty
  std::string what;         // a few words for the table
  std::string says;         // the claim in one sentence
  std::string paper, ours;  // both values as people read them
  std::optional<double> paper_value, our_value;
  std::string unit;
  Verdict verdict = Verdict::kDiffers;
  std::string reason;
  // One object a reading of what the paper leaves open: {"upright, 90 mm": {"mean_rad": 0.51, ...}, ...}
  nlohmann::ordered_json readings = nlohmann::ordered_json::object();
  std::string plot;  // name of the page's plot that shows it; may be empty
};

/// A CSV file of the results.
class Series {
 public:
  Series(const std::filesystem::path& path, const std::vector<std::string>& columns);
  CsvWriter& row() { return writer_; }

 private:
  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  std::unique_ptr<std::FILE, Close> file_;
  CsvWriter writer_;
};

/// The results so far, and a word on stderr of what is being computed.
class Study {
 public:
  explicit Study(std::filesystem::path folder);

  void Begin(const std::string& stage);
  void Progress(double share);
  void Add(Claim claim) { claims_.push_back(std::move(claim)); }
  Series OpenSeries(const std::string& name, const std::vector<std::string>& columns) const {
    return {folder_ / (name + ".csv"), columns};
  }
  /// Ends the progress line; the claims in the paper's order.
  const std::vector<Claim>& Finish();

 private:
  void Show(bool last);

  std::filesystem::path folder_;
  std::vector<Claim> claims_;
  std::string stage_;
  double start_s_, stage_start_s_ = 0;
  int percent_ = 0;
  bool terminal_;
};

/// Relative distance |ours - paper| / |paper|.
double Apart(double ours, double paper);

// ---- the paper, part by part; each adds its claims ----

void CircleGeometry(Study& study);     // eq. 31
void ZeroTension(Study& study);        // 3.1, Fig. 4
void SingleTendon(Study& study);       // 3.2, Fig. 5
void PulleyCurves(Study& study);       // 4, Fig. 7
void PlanarBend(Study& study);         // 5.1, Fig. 11
void SpatialCircle(Study& study);      // 5.2, Fig. 13
void ConstantCurvature(Study& study);  // 6

}  // namespace tendril::tools::reproduce
