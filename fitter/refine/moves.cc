#include "fitter/refine/moves.h"

#include <algorithm>
#include <utility>

namespace armtrue {
namespace {

// An effect below this share of the squares that the search's largest effect (tables aside)
// explains may be an artefact of linearising without the latter: it waits for the next search. So
// does one that explains nothing alone.
constexpr double kBeyondSecondOrder = 0.02;

// A table of one joint is added together with equally probable ones of other joints: what each
// explains shows only beside the others.
Candidate with_its_like(const Diagnosis& d, const Candidate& best) {
  Candidate wide = best;
  if (find_effect(best.request.effect).joint_rule() != JointRule::kEach || !is_table(best))
    return wide;
  for (const Candidate& c : d.candidates) {
    if (&c == &best || c.request.effect != best.request.effect || c.probability < kSurely ||
        c.request.options != best.request.options || c.request.joints == best.request.joints)
      continue;
    wide.request.joints.insert(wide.request.joints.end(), c.request.joints.begin(),
                               c.request.joints.end());
    wide.parameters.insert(wide.parameters.end(), c.parameters.begin(), c.parameters.end());
    wide.sigma.insert(wide.sigma.end(), c.sigma.begin(), c.sigma.end());
  }
  std::sort(wide.request.joints.begin(), wide.request.joints.end());
  return wide;
}

}  // namespace

bool is_sure(const Candidate& c) { return c.likeliest && !c.spanned && c.in_any_form >= kSurely; }

bool names(const Candidate& one, const Candidate& other) {
  return std::ranges::find(one.confounded_with, label(other.request)) != one.confounded_with.end();
}

bool is_table(const Candidate& c) { return find_effect(c.request.effect).generic(); }

std::vector<Move> moves_of(const Diagnosis& d) {
  std::vector<Move> moves;
  const Candidate* best = d.recommended();
  std::vector<const Candidate*> sure;
  double most = 0.0;
  for (const Candidate& c : d.candidates) {
    // Forms of one effect share the probability that makes them sure. The most probable form is
    // added; another one waits for the next search.
    const bool other_form = std::ranges::any_of(
        sure, [&](const Candidate* s) { return label(s->request) == label(c.request); });
    if (!best || !is_sure(c) || other_form) continue;
    sure.push_back(&c);
    if (!is_table(c)) most = std::max(most, c.gain_beside);
  }
  std::erase_if(sure, [&](const Candidate* c) {
    return c->gain_beside < kBeyondSecondOrder * most || (c != best && c->delta_bic > 0.0);
  });
  std::stable_sort(sure.begin(), sure.end(), [](const Candidate* a, const Candidate* b) {
    return std::pair{is_table(*a), -a->gain_beside} < std::pair{is_table(*b), -b->gain_beside};
  });
  // If two candidates may stand for one another, the second waits for a search beside the first.
  std::vector<const Candidate*> taken;
  for (const Candidate* c : sure) {
    if (std::ranges::any_of(taken,
                            [&](const Candidate* t) { return names(*t, *c) || names(*c, *t); }))
      continue;
    taken.push_back(c);
    moves.push_back({with_its_like(d, *c), {}, true});
  }
  if (best) moves.push_back({with_its_like(d, *best), {}});
  for (const Candidate& c : d.candidates) {
    if (best && !c.spanned && !c.left_out && c.probability > kMoreLikelyThanNot)
      moves.push_back({c, {}});
  }
  for (const Superfluous& s : d.superfluous) moves.push_back({std::nullopt, {s.request}});
  if (best) return moves;
  // Exchanges of an effect that is probably absent for a candidate that is probably present.
  for (const Superfluous& s : d.superfluous) {
    for (const Candidate& c : d.candidates) {
      if (c.probability <= kMoreLikelyThanNot) continue;
      moves.push_back({c, {s.request}});
      // Beside the effect that it replaces, it explains too little for the search to pair the two.
      std::vector<std::string>& named = moves.back().added->confounded_with;
      if (std::ranges::find(named, label(s.request)) == named.end())
        named.push_back(label(s.request));
    }
  }
  return moves;
}

ModelSpecification apply(ModelSpecification specification, const Move& move,
                         const EffectContext& context) {
  for (const EffectRequest& r : move.removed)
    specification = without_effect(specification, r, context);
  return move.added ? with_effect(specification, move.added->request) : specification;
}

}  // namespace armtrue
