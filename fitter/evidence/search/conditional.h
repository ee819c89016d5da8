// Distribution of one block of a search given all others: its absence, and each of its prior sizes.
#pragma once

#include <compare>
#include <vector>

#include "fitter/evidence/search/elimination.h"
#include "fitter/evidence/search/search.h"

namespace armtrue {

/// A block's presence, with one of its prior shapes at one of that shape's sizes, or its absence.
struct Choice {
  int shape = -1, scale = -1;  // −1: absent
  bool is_present() const { return shape >= 0; }
  auto operator<=>(const Choice&) const = default;
};

/// log Σ exp.
double log_sum(const std::vector<double>& terms);

/// The choices of a block and their weights.
struct Conditional {
  std::vector<Choice> choices;      ///< the first is absence
  std::vector<double> log_weight;   ///< log evidence with its prior, up to a common constant
  std::vector<double> log_physics;  ///< the part of it from sign rules and carried loads
  double probability() const { return -std::expm1(log_weight.front() - log_sum(log_weight)); }
};

/// The part of a model's log evidence from its Σ r² (`squares`), with the noise's variance
/// integrated out, up to a constant common to all models.
double fit_term(const SearchProblem& problem, double squares);

/// Weighs all choices of a block. `local`: its normal equations with the other blocks eliminated.
Conditional weigh_choices(const SearchProblem& problem, const SearchBlock& block,
                          const Elimination::Local& local);

}  // namespace armtrue
