// Recommendations for the next step, in sentences.
#pragma once

#include <string>
#include <vector>

namespace armtrue {

struct Diagnosis;
class Fit;
struct Linearization;

/// Advice that follows from a diagnosis of `fit`: what to add, what to measure to separate
/// confounded effects, what to record, and what repeats badly. `linearization`: as in the
/// diagnosis.
std::vector<std::string> advise(const Diagnosis& diagnosis, const Fit& fit,
                                const Linearization& linearization);

}  // namespace armtrue
