// Phrases a diagnosis in words. Knows nothing of how it was found.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

// A cause that leaves more is not the only one.
constexpr double kMuchLeft_sigma = 1;

/// "routing_friction (tendon:2)".
std::string NameOf(const Cause& cause);

/// `robot`: the nominal robot. `hiding`: the two causes that would explain the gap by cancelling each other,
/// and where; else empty.
std::string Sentence(const Diagnosis& d, const RobotParameters& robot, const std::string& hiding);

/// The text that precedes everything else: the numbers of the robot file that the runs point to, or why the
/// likeliest cause is not established; else empty.
std::string Preface(const Diagnosis& d);

/// The first question to ask about an unexplained gap that fewer than half of the runs have. `missed`: ratio
/// of their model error to that of the other runs.
std::string FewRunsRemark(const Diagnosis& d, const std::map<std::string, double>& missed);

/// The sentence preceded by the numbers of the file that were fitted for it, those furthest from the file
/// first.
std::string WithLearned(const std::string& sentence, const std::vector<LearnedNumber>& learned);

/// The sentence preceded by the runs it does not use: "With 2 of 7 runs left out (a, b: too short), the gap
/// lies ...". Only lines of `notes` of the form "left out: NAME: reason" count.
std::string WithLeftOut(const std::string& sentence, const std::vector<std::string>& notes, std::size_t used);

}  // namespace tendril::gap
