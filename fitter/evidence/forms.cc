#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "fitter/evidence/blocks.h"

namespace armtrue {
namespace {

// Half a grid cell, as a share of the distance between the cell's two neighbours.
constexpr double kHalfCell = 0.25;
// A block that alone explains at least this share of what the best one explains may be the missing
// effect.
constexpr double kMuch = 0.8;

// The neighbours of an option's value on a block's grid.
std::pair<double, double> neighbours(const EvidenceBlock& block, const std::string& option,
                                     double at) {
  double below = -std::numeric_limits<double>::infinity();
  double above = std::numeric_limits<double>::infinity();
  for (const EvidenceForm& form : block.forms) {
    const auto value = form.block.request.options[option].get<double>();
    if (value < at) below = std::max(below, value);
    if (value > at) above = std::min(above, value);
  }
  if (!std::isfinite(below)) below = at;
  if (!std::isfinite(above)) above = at;
  return {below, above};
}

std::vector<std::string> numeric_options(const EffectRequest& request) {
  std::vector<std::string> result;
  for (const std::string& option : find_effect(request.effect).searched_options()) {
    if (request.options.contains(option) && request.options[option].is_number())
      result.push_back(option);
  }
  return result;
}

// The form of a block at another value of an option: from the block's grid if it is there.
Block form_at(const EffectContext& context, const EvidenceBlock& block, EffectRequest request,
              const std::string& option, double value) {
  request.options[option] = value;
  for (const EvidenceForm& form : block.forms) {
    if (form.block.request.options != request.options) continue;
    Block own = form.block;
    own.terms.parameters.resize(form.own);
    return own;
  }
  return make_block(context, request);
}

// Adds slopes to a form: its change while a nonlinear parameter moves from the middle of its cell
// to the edge.
void add_slopes(const EffectContext& context, const EvidenceBlock& block, EvidenceForm& form) {
  for (const std::string& option : numeric_options(form.block.request)) {
    const auto at = form.block.request.options[option].get<double>();
    const auto [below, above] = neighbours(block, option, at);
    if (!(above > below)) continue;
    const Block lower = form_at(context, block, form.block.request, option, below);
    const Block upper = form_at(context, block, form.block.request, option, above);
    for (std::size_t c = 0; c < form.own; ++c) {
      Parameter slope = upper.terms.parameters[c];
      slope.sign = 0;
      for (Term& term : slope.terms) term.weight *= kHalfCell;
      for (Term term : lower.terms.parameters[c].terms) {
        term.weight *= -kHalfCell;
        slope.terms.push_back(std::move(term));
      }
      form.block.terms.parameters.push_back(std::move(slope));
      form.like.push_back(c);
    }
  }
}

// Replaces a form's grid cell by cells of half its width.
void halve(const Fit& fit, EvidenceBlock& block, const EvidenceForm& coarse) {
  std::vector<EffectRequest> near{coarse.block.request};
  for (const std::string& option : numeric_options(coarse.block.request)) {
    const auto at = coarse.block.request.options[option].get<double>();
    const auto [below, above] = neighbours(block, option, at);
    std::vector<EffectRequest> more;
    for (const EffectRequest& request : near) {
      for (const double value : {0.5 * (at + below), at, 0.5 * (at + above)}) {
        more.push_back(request);
        more.back().options[option] = value;
      }
    }
    near = std::move(more);
  }
  std::erase_if(block.forms, [&](const EvidenceForm& form) {
    return form.block.request.options == coarse.block.request.options;
  });
  const double halved = std::log(2.0) * static_cast<double>(numeric_options(near[0]).size());
  const std::size_t first = block.forms.size();
  for (const EffectRequest& request : near) {
    // Halved cells of neighbours share the form in the middle between them, which is added once.
    if (std::ranges::any_of(block.forms, [&](const EvidenceForm& form) {
          return form.block.request.options == request.options;
        }))
      continue;
    block.forms.emplace_back(make_block(fit.context(), request));
    block.forms.back().log_prior = coarse.log_prior - halved;
    block.forms.back().halved = true;
  }
  for (std::size_t f = first; f < block.forms.size(); ++f)
    add_slopes(fit.context(), block, block.forms[f]);
}

int form_of(const EvidenceBlock& block, int shape) {
  return block.search.shapes[static_cast<std::size_t>(shape)].form;
}

}  // namespace

EvidenceForm::EvidenceForm(Block b) : block(std::move(b)), own(block.terms.parameters.size()) {
  for (std::size_t c = 0; c < own; ++c) like.push_back(c);
}

void add_all_slopes(const EffectContext& context, std::vector<EvidenceBlock>& blocks) {
  for (EvidenceBlock& block : blocks) {
    if (block.forms.size() < 2) continue;
    for (EvidenceForm& form : block.forms) {
      if (!form.found) add_slopes(context, block, form);
    }
  }
}

void refine_forms(const Fit& fit, std::vector<EvidenceBlock>& blocks, const SearchResult& search) {
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    EvidenceBlock& block = blocks[b];
    if (block.forms.size() < 2 || block.present) continue;
    // The best form beside the likeliest set, and the best beside the fit alone: the likeliest set
    // may contain a wrong effect in place of this one.
    const std::set<int> best{form_of(block, search.shape[b]),
                             form_of(block, search.alone_shape[b])};
    const std::vector<EvidenceForm> before = block.forms;
    for (const int form : best) halve(fit, block, before[static_cast<std::size_t>(form)]);
    block.columns.resize(0, 0);
    block.search = SearchBlock{};
  }
}

bool wants_finer_forms(const std::vector<EvidenceBlock>& blocks, const SearchResult& search) {
  const double most = *std::max_element(search.alone_gain.begin(), search.alone_gain.end());
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (blocks[b].forms.size() < 2 || blocks[b].present || search.alone_gain[b] < kMuch * most)
      continue;
    const int form = form_of(blocks[b], search.alone_shape[b]);
    if (!blocks[b].forms[static_cast<std::size_t>(form)].halved) return true;
  }
  return false;
}

}  // namespace armtrue
