#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "fitter/evidence/blocks.h"

namespace armtrue {
namespace {

// Half a cell of the distance between a cell's two neighbours.
constexpr double kHalfCell = 0.25;

// The neighbours of an option's value on a block's grid.
std::pair<double, double> neighbours(const EvidenceBlock& block, const std::string& option,
                                     double at) {
  double below = -std::numeric_limits<double>::infinity();
  double above = std::numeric_limits<double>::infinity();
  for (const EvidenceForm& form : block.forms) {
    const double value = form.block.request.options[option];
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

// The form of a block at other values of an option: from its grid where it stands there.
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

// What a form changes by while its nonlinear parameters move from the middle of their cells to the
// edge.
void add_slopes(const EffectContext& context, const EvidenceBlock& block, EvidenceForm& form) {
  for (const std::string& option : numeric_options(form.block.request)) {
    const double at = form.block.request.options[option];
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

}  // namespace

EvidenceForm::EvidenceForm(Block b) : block(std::move(b)), own(block.terms.parameters.size()) {
  for (std::size_t c = 0; c < own; ++c) like.push_back(c);
}

void add_all_slopes(const EffectContext& context, std::vector<EvidenceBlock>& blocks) {
  for (EvidenceBlock& block : blocks) {
    if (block.forms.size() < 2) continue;
    for (EvidenceForm& form : block.forms) {
      form.log_prior = -std::log(static_cast<double>(block.forms.size()));
      add_slopes(context, block, form);
    }
  }
}

void refine_forms(const Fit& fit, std::vector<EvidenceBlock>& blocks, const SearchResult& search) {
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    EvidenceBlock& block = blocks[b];
    if (block.forms.size() < 2) continue;
    const auto shape = static_cast<std::size_t>(search.shape[b]);
    const EvidenceForm best =
        block.forms[static_cast<std::size_t>(block.search.shapes[shape].form)];
    std::vector<EffectRequest> near{best.block.request};
    for (const std::string& option : numeric_options(best.block.request)) {
      const double at = best.block.request.options[option];
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
    std::vector<EvidenceForm> finer;
    const double halved = std::log(2.0) * static_cast<double>(numeric_options(near[0]).size());
    for (const EffectRequest& request : near) {
      finer.emplace_back(make_block(fit.context(), request));
      finer.back().log_prior = best.log_prior - halved;
    }
    // The cell that is refined is now made of finer ones.
    std::erase_if(block.forms, [&](const EvidenceForm& form) {
      return form.block.request.options == best.block.request.options;
    });
    const std::size_t first = block.forms.size();
    std::move(finer.begin(), finer.end(), std::back_inserter(block.forms));
    for (std::size_t f = first; f < block.forms.size(); ++f)
      add_slopes(fit.context(), block, block.forms[f]);
    block.columns.resize(0, 0);
    block.search = SearchBlock{};
  }
}

}  // namespace armtrue
