#include "fitter/inference/identifiability.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace armtrue {
namespace {

// Standard deviation to which a parameter without prior must be determined: a metre, a radian.
constexpr double kNoPriorSigma = 1.0;
// A remainder of at most this share of a column's own information is rounding error of JᵀJ.
constexpr double kRounding = 3e-13;
// An effect's coefficient must be determined to a third of its physical bound.
constexpr double kBoundsPerSigma = 3.0;

// Columns with at least this share of their information independent of the accepted columns are
// accepted in the order of preference, the others by largest gain. Otherwise two nearly parallel
// axes could represent a shift by opposite rotations that are a hundred times as large.
constexpr double kClearShare = 0.1;
constexpr double kClearlyMore = 1.01;
// Geometry with a smaller independent share is separable by second-order terms only, if at all.
// Effects are accepted before such geometry, which could otherwise replace an effect.
constexpr double kFaintShare = 1e-6;
// Preferences from here on are not geometry.
constexpr int kFirstEffect = 10;

// Base and tool come first, because they may have any value. Of a link's five parameters, those
// among Craig's four come first.
int preference(const Parameter& p) {
  const Role role = find_effect(p.effect).role();
  if (p.terms.empty() || (role != Role::kPlacement && role != Role::kGeometry)) return kFirstEffect;
  const Coordinate& at = p.terms.front().coordinate;
  switch (at.place) {
    case Place::kBase:
      return 0;
    case Place::kTool:
      return 1;
    case Place::kMotor:
      return 2;
    case Place::kLink:
      break;
  }
  constexpr std::array<int, 6> kOrder{3, 6, 5, 4, 7, 7};  // tx ty tz rx ry rz
  return kOrder[static_cast<std::size_t>(at.component)];
}

// Standard deviation to which the data must determine a parameter.
double worthwhile_sigma(const Parameter& p) {
  const double prior = p.prior_sigma > 0.0 ? p.prior_sigma : kNoPriorSigma;
  if (preference(p) < kFirstEffect || p.bound <= 0.0) return prior;
  return std::min(prior, p.bound / kBoundsPerSigma);
}

// Cholesky factorisation of the information on some unknowns, scaled to a unit diagonal. Columns
// are accepted one by one; the Schur complement of the others is kept (Golub and Van Loan, Matrix
// Computations, 4.2.9). An accepted parameter explains the effect of another only within its own
// prior: the moment of a link is not explained by a mass that would have to be ten times as large.
class RankRevealing {
 public:
  // `priors`: the prior's information (1/sigma²) on each of the unknowns; 0: no prior.
  RankRevealing(const Eigen::MatrixXd& information, const std::vector<int>& unknowns,
                Eigen::VectorXd priors)
      : priors_(std::move(priors)), accepted_at_(unknowns.size(), -1) {
    const auto size = static_cast<Eigen::Index>(unknowns.size());
    own_.resize(size);
    for (Eigen::Index v = 0; v < size; ++v) {
      const int u = unknowns[static_cast<std::size_t>(v)];
      own_[v] = std::max(0.0, information(u, u));
    }
    const Eigen::VectorXd scale = (own_.array() > 0.0).select(own_.array().rsqrt(), 0.0);
    rest_ = scale.asDiagonal() * information(unknowns, unknowns) * scale.asDiagonal();
    priors_.array() *= scale.array().square();
    factor_.setZero(size, size);
  }

  double own(Eigen::Index v) const { return own_[v]; }
  // Share of the column's information that is independent of the accepted columns.
  double share(Eigen::Index v) const { return own_[v] > 0.0 ? rest_(v, v) : 0.0; }
  bool is_accepted(Eigen::Index v) const { return accepted_at_[static_cast<std::size_t>(v)] >= 0; }

  // Accepts columns of [begin, end) with a gain above 1: first those with a share of at least
  // kClearShare, in order, then those with at least `least_share`, by largest gain.
  template <typename Gain>
  void accept_between(Eigen::Index begin, Eigen::Index end, double least_share, const Gain& gain) {
    for (Eigen::Index v = begin; v < end; ++v) {
      if (share(v) >= kClearShare && gain(v) > 1.0) accept(v);
    }
    for (;;) {
      Eigen::Index best = -1;
      double most = 1.0;
      for (Eigen::Index v = begin; v < end; ++v) {
        // Gains that differ only by rounding are equal: the earlier column is accepted, at every
        // noise level.
        if (is_accepted(v) || share(v) < least_share || gain(v) <= most) continue;
        best = v;
        most = kClearlyMore * gain(v);
      }
      if (best < 0) return;
      accept(best);
    }
  }

  // Accepts the columns that another factorisation of the same unknowns has accepted, in its order.
  void accept_as(const RankRevealing& other) {
    for (const Eigen::Index v : other.accepted_) accept(v);
  }

  // The accepted column with the largest coefficient when the accepted columns reproduce column v;
  // −1 if none is accepted.
  Eigen::Index largest_stand_in(Eigen::Index v) const {
    const auto count = static_cast<Eigen::Index>(accepted_.size());
    if (count == 0) return -1;
    const Eigen::MatrixXd lower = factor_(accepted_, Eigen::seqN(0, count));
    const Eigen::VectorXd stand_in = lower.triangularView<Eigen::Lower>().transpose().solve(
        factor_.row(v).head(count).transpose());
    Eigen::Index top = 0;
    stand_in.cwiseAbs().maxCoeff(&top);
    return accepted_[static_cast<std::size_t>(top)];
  }

 private:
  void accept(Eigen::Index v) {
    const auto count = static_cast<Eigen::Index>(accepted_.size());
    const double pivot = std::sqrt(rest_(v, v) + priors_[v]);
    factor_.col(count) = rest_.col(v) / pivot;
    rest_.noalias() -= factor_.col(count) * factor_.col(count).transpose();
    for (const Eigen::Index before : accepted_) factor_(before, count) = 0.0;
    factor_(v, count) = pivot;
    accepted_at_[static_cast<std::size_t>(v)] = static_cast<int>(count);
    accepted_.push_back(v);
  }

  Eigen::VectorXd own_, priors_;
  Eigen::MatrixXd rest_;    // Schur complement of the accepted columns
  Eigen::MatrixXd factor_;  // row: column of the information; column: order of acceptance
  std::vector<Eigen::Index> accepted_;
  std::vector<int> accepted_at_;
};

// Gauges and smoothness of tables count as information. Priors do not: identify() compares the
// information with them.
Eigen::MatrixXd information_of(const Design& design) {
  const NormalEquations equations = accumulate(design);
  Eigen::MatrixXd information = equations.information.selfadjointView<Eigen::Lower>();
  for (const PenaltyRow& row : penalty_rows(design, 1e-4)) {
    if (row.entries.size() < 2) continue;
    for (const auto& [ua, fa] : row.entries) {
      for (const auto& [ub, fb] : row.entries) information(ua, ub) += fa * fb;
    }
  }
  return information;
}

// Chooses the unknowns that the data can tell apart, and factorises their information. `order`:
// unknowns of the design, preferred ones first; `parameters`: the parameter of each.
RankRevealing told_apart(const Design& design, const std::vector<int>& order,
                         const std::vector<const Parameter*>& parameters) {
  Eigen::VectorXd priors(static_cast<Eigen::Index>(order.size()));
  std::ranges::transform(parameters, priors.begin(), [](const Parameter* p) {
    return preference(*p) < kFirstEffect || p->prior_sigma <= 0.0 ? 0.0
                                                                  : std::pow(p->prior_sigma, -2);
  });
  const auto gain_in = [&](const RankRevealing& factor, Eigen::Index v) {
    const double sigma = worthwhile_sigma(*parameters[static_cast<std::size_t>(v)]);
    return factor.share(v) > kRounding ? factor.share(v) * factor.own(v) * sigma * sigma : 0.0;
  };
  const auto geometry_end = std::ranges::find_if(
      parameters, [](const Parameter* p) { return preference(*p) >= kFirstEffect; });
  const auto effects = static_cast<Eigen::Index>(geometry_end - parameters.begin());
  // Geometry is accepted first, at constant loads. A mass explains better what geometry does only
  // by changing the loads.
  RankRevealing unloaded(information_of(design.with_loads_held()), order, priors);
  const auto unloaded_gain = [&](Eigen::Index v) { return gain_in(unloaded, v); };
  unloaded.accept_between(0, effects, kFaintShare, unloaded_gain);
  RankRevealing factor = unloaded;
  if (design.loads_follow()) {
    factor = RankRevealing(information_of(design), order, std::move(priors));
    factor.accept_as(unloaded);
  }
  const auto gain = [&](Eigen::Index v) { return gain_in(factor, v); };
  factor.accept_between(effects, static_cast<Eigen::Index>(order.size()), 0.0, gain);
  factor.accept_between(0, effects, 0.0,
                        [&](Eigen::Index v) { return unloaded_gain(v) > 1.0 ? gain(v) : 0.0; });
  return factor;
}

}  // namespace

std::string describe(const Parameter& p) { return find_effect(p.effect).describe(p); }

Identifiability identify(const Design& design) {
  const Model& model = design.model();
  std::vector<int> order;   // unknowns that may be held
  std::vector<int> always;  // tables and nonlinear parameters
  for (int u = 0; u < design.unknowns(); ++u) {
    const bool linear = u < static_cast<int>(design.free_parameters().size());
    (linear && !design.is_table_unknown(u) ? order : always).push_back(u);
  }
  const auto parameter_of = [&](int u) -> const Parameter& {
    return model.parameters[static_cast<std::size_t>(
        design.free_parameters()[static_cast<std::size_t>(u)])];
  };
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return preference(parameter_of(a)) < preference(parameter_of(b));
  });

  std::vector<const Parameter*> parameters;
  for (const int u : order) parameters.push_back(&parameter_of(u));
  const RankRevealing factor = told_apart(design, order, parameters);
  Identifiability result;
  for (Eigen::Index v = 0; v < static_cast<Eigen::Index>(order.size()); ++v) {
    const int parameter =
        design.free_parameters()[static_cast<std::size_t>(order[static_cast<std::size_t>(v)])];
    if (factor.is_accepted(v)) {
      result.kept.push_back(parameter);
      continue;
    }
    const Parameter& p = model.parameters[static_cast<std::size_t>(parameter)];
    const double sigma = worthwhile_sigma(p);
    Unidentifiable held;
    held.parameter = parameter;
    held.exact = factor.share(v) < 1e-9;
    const Eigen::Index stand_in = factor.largest_stand_in(v);
    if (factor.own(v) * sigma * sigma <= 1e-6 || stand_in < 0) {
      held.sentence = describe(p) + " does not move the tool in these poses: held at nominal";
    } else {
      const int kept = order[static_cast<std::size_t>(stand_in)];
      held.explained_by = design.free_parameters()[static_cast<std::size_t>(kept)];
      const std::string pair = describe(p) + " and " + describe(parameter_of(kept));
      held.sentence =
          held.exact
              ? pair + " are one number: the first is held at nominal"
              : pair + " can hardly be told apart by these poses: the first is held at nominal";
    }
    result.held.push_back(held);
  }
  for (const int u : always) {
    if (u < static_cast<int>(design.free_parameters().size())) {
      result.kept.push_back(design.free_parameters()[static_cast<std::size_t>(u)]);
    }
  }
  std::sort(result.kept.begin(), result.kept.end());
  return result;
}

}  // namespace armtrue
