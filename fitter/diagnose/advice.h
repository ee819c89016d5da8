// What to do next, in sentences.
#pragma once

#include <string>
#include <vector>

namespace armtrue {

struct Diagnosis;
class Fit;

/// Advice that follows from a diagnosis: what to add, what to measure to split an ambiguity, what
/// to record.
std::vector<std::string> advise(const Diagnosis& diagnosis, const Fit& fit);

}  // namespace armtrue
