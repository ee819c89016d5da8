// What to do next, in sentences.
#pragma once

#include <string>
#include <vector>

namespace armtrue {

struct Diagnosis;
class Fit;
struct Linearization;

/// Advice that follows from a diagnosis of `fit`, linearised as the diagnosis had it: what to add,
/// what to measure to split an ambiguity, what to record; and what repeats badly.
std::vector<std::string> advise(const Diagnosis& diagnosis, const Fit& fit,
                                const Linearization& linearization);

}  // namespace armtrue
