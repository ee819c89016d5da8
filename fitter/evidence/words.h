// Numbers as text in the sentences of the diagnosis.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "fitter/solve/fit.h"

namespace armtrue {

/// Up to six digits, no trailing zeros.
std::string number_words(double value);
/// "[13,26.5]" of an array of numbers.
std::string list_words(const nlohmann::json& values);
/// "12.3 um" of metres.
std::string micrometre_words(double metres);
/// The effects of a fit that depend on the arm's past, and what knowing the past would be worth.
std::string history_words(const Fit& fit);

}  // namespace armtrue
