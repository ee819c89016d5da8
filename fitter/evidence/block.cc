#include "fitter/evidence/block.h"

#include <algorithm>
#include <set>

namespace armtrue {
namespace {

std::set<std::string> parameter_names(const Model& model) {
  std::set<std::string> names;
  for (const Parameter& p : model.parameters) names.insert(p.name);
  return names;
}

}  // namespace

EffectRequest as_added(const EffectRequest& request) {
  EffectRequest result = request;
  for (const std::string& option : find_effect(request.effect).searched_options())
    result.options.erase(option);
  return result;
}

Block make_block(const EffectContext& context, const EffectRequest& request) {
  Block block{request, build_effect(context, request), 0};
  std::map<std::string, double> values;
  for (const NonlinearParameter& p : block.terms.nonlinear) values[p.name] = p.value;
  for (Parameter& p : block.terms.parameters) {
    for (Term& term : p.terms) term.basis = term.basis.substitute(values);
  }
  // A nonlinear parameter that is chosen on a grid costs a degree of freedom like any other
  // unknown.
  const EffectRequest added = as_added(request);
  block.searched = static_cast<int>(added.options == request.options
                                        ? block.terms.nonlinear.size()
                                        : build_effect(context, added).nonlinear.size());
  return block;
}

std::vector<Block> catalogue_blocks(const Fit& fit) {
  std::vector<Block> blocks;
  const EffectContext& context = fit.context();
  const std::set<std::string> present = parameter_names(fit.model());
  for (const Effect* effect : effect_catalogue()) {
    for (const EffectRequest& request : effect->tried(context)) {
      if (!effect->missing(context, request.joints).empty()) continue;
      Block block = make_block(context, request);
      const bool held = std::any_of(block.terms.parameters.begin(), block.terms.parameters.end(),
                                    [&](const Parameter& p) { return present.contains(p.name); });
      if (!held && !block.terms.parameters.empty()) blocks.push_back(std::move(block));
    }
  }
  return blocks;
}

std::vector<Untestable> untestable_effects(const EffectContext& context) {
  std::vector<Untestable> result;
  for (const Effect* effect : effect_catalogue()) {
    std::set<std::string> needs;
    bool testable = false;
    for (const EffectRequest& request : effect->tried(context)) {
      const std::vector<std::string> missing = effect->missing(context, request.joints);
      needs.insert(missing.begin(), missing.end());
      testable = testable || missing.empty();
    }
    // Columns that only some joints lack are listed although the effect is testable on others. An
    // effect without candidate requests is judged by its default joints.
    if (!testable && needs.empty()) {
      const std::vector<std::string> missing =
          effect->missing(context, effect->joints_of_bare_entry(context));
      needs.insert(missing.begin(), missing.end());
    }
    if (!needs.empty()) result.push_back({effect->id(), {needs.begin(), needs.end()}});
  }
  return result;
}

nlohmann::json to_json(const std::vector<Untestable>& untestable) {
  nlohmann::json result = nlohmann::json::array();
  for (const Untestable& u : untestable)
    result.push_back({{"effect", u.effect}, {"needs", u.needs}});
  return result;
}

}  // namespace armtrue
