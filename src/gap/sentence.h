// A diagnosis in words. Knows nothing of how it was found.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

// A cause that leaves more is not all that there is.
constexpr double kMuchLeft_sigma = 1;

/// "routing_friction (tendon:2)".
std::string NameOf(const Cause& cause);

/// `robot`: the nominal one. `hiding`: the two that would explain the gap by hiding each other, and where;
/// else empty.
std::string Sentence(const Diagnosis& d, const RobotParameters& robot, const std::string& hiding);

/// What stands before everything else: the numbers of the robot file that the runs point to, or why the
/// likeliest cause is not established. Empty where neither is so.
std::string First(const Diagnosis& d);

/// What is to be asked first of a gap that nothing explains, where less than half of the runs have it:
/// `missed` by so many times more than the others.
std::string InFewRuns(const Diagnosis& d, const std::map<std::string, double>& missed);

/// The sentence with what it is not based on said first: "With 2 of 7 runs left out (a, b: too short), the
/// gap lies ...". `notes` are lines of which those count that say "left out: NAME: reason".
std::string WithLeftOut(const std::string& sentence, const std::vector<std::string>& notes, std::size_t used);

}  // namespace tendril::gap
