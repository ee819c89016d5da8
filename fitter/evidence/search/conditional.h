// One block of a search given all others: how probable each of its sizes is, and its absence.
#pragma once

#include <compare>
#include <vector>

#include "fitter/evidence/search/elimination.h"
#include "fitter/evidence/search/search.h"

namespace armtrue {

/// A block's presence: which of its prior shapes, at which of that shape's sizes.
struct Choice {
  int shape = -1, scale = -1;  // −1: absent
  bool is_present() const { return shape >= 0; }
  auto operator<=>(const Choice&) const = default;
};

/// log Σ exp.
double log_sum(const std::vector<double>& terms);

/// What a block may be, and how probable that is.
struct Conditional {
  std::vector<Choice> choices;      ///< the first is absence
  std::vector<double> log_weight;   ///< log evidence with its prior, up to a common constant
  std::vector<double> log_physics;  ///< the part of it that signs and loads of coefficients make
  double probability() const { return -std::expm1(log_weight.front() - log_sum(log_weight)); }
};

/// Log evidence of a model that leaves `squares`, up to what all models share: the noise's variance
/// is integrated out.
double fit_term(const SearchProblem& problem, double squares);

/// All choices of a block of which `local` is what the others leave.
Conditional weigh_choices(const SearchProblem& problem, const SearchBlock& block,
                          const Elimination::Local& local);

}  // namespace armtrue
