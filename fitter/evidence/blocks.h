// Builds the blocks of one search from a fit and the catalogue.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "fitter/evidence/block.h"
#include "fitter/evidence/linearization.h"
#include "fitter/evidence/search/search.h"

namespace armtrue {

/// Whitened columns of all parameters of some blocks, one after the other.
Eigen::MatrixXd block_columns(const Linearization& linearization, const State& state,
                              std::span<const Block> blocks);

/// A block at given nonlinear parameters, with slopes: additional columns for its change while
/// these parameters move within their grid cell.
struct EvidenceForm {
  Block block;                    ///< its own parameters first, then the slopes
  std::size_t own = 0;            ///< number of parameters that are not slopes
  std::vector<std::size_t> like;  ///< by parameter: the own one whose prior size it shares
  double log_prior = 0.0;         ///< probability of this form, given the block
  bool halved = false;            ///< its grid cell is half of a coarser one
  bool found = false;  ///< the fit's form: at the fitted nonlinear parameters, with their slopes

  EvidenceForm() = default;
  EvidenceForm(Block b);  ///< without slopes
};

/// An effect on its joints, in one of several forms (a time constant, a period) that the search
/// chooses from.
struct EvidenceBlock {
  EffectRequest request;  ///< as it would be added
  std::string label;
  std::string kind;  ///< blocks of one kind share its prior odds
  std::vector<EvidenceForm> forms;
  bool present = false;       ///< is in the fit
  bool believed = false;      ///< put into the model by the user, not by a search
  bool structure = false;     ///< a smooth function that belongs to no effect
  bool is_cause = false;      ///< a structure, but a known cause that no recorded column shows
  bool unknown_load = false;  ///< springs loaded by unknown masses
  std::size_t finding = 0;    ///< of a structure: index in Structure::findings
  double tried = 0.0;  ///< alternatives it was selected from, which divide its prior odds; 0: none
  SearchBlock search;
  Eigen::MatrixXd columns;  ///< columns of `search`; empty: not yet computed
};

/// Input of a search: columns of the base, which is always in the model, and blocks with theirs.
struct EvidenceModel {
  Eigen::MatrixXd base;  ///< equations × coefficients of geometry, placement and a user's own terms
  Eigen::MatrixXd base_precision;  ///< precision of their prior
  Eigen::VectorXd base_pull;       ///< gradient of that prior at the present values
  double base_pull_squares = 0.0;
  Eigen::VectorXd y;  ///< to explain: by changes of base from present values, by blocks from zero
  std::vector<EvidenceBlock> blocks;

  /// Number of columns of all blocks.
  Eigen::Index width() const {
    return blocks.empty() ? 0 : blocks.back().search.first + blocks.back().search.width;
  }
};

/// Blocks that may enter the fit (from the catalogue) and blocks that may leave it, without
/// columns.
std::vector<EvidenceBlock> evidence_blocks(Fit& fit, const Linearization& linearization,
                                           std::vector<Block> catalogue);

/// Columns and priors of the blocks, and of the base: all else in the fit.
EvidenceModel make_evidence_model(Fit& fit, const Linearization& linearization,
                                  std::vector<EvidenceBlock> blocks);

/// Adds slopes to the forms of blocks that have several.
void add_all_slopes(const EffectContext& context, std::vector<EvidenceBlock>& blocks);

/// Replaces the grid cells of the best forms by halved ones, for blocks with several forms.
void refine_forms(const Fit& fit, std::vector<EvidenceBlock>& blocks, const SearchResult& search);

/// True if a block that alone explains about as much as the best one has its best form on the
/// coarse grid only.
bool wants_finer_forms(const std::vector<EvidenceBlock>& blocks, const SearchResult& search);

/// The parts of a model's entry that a search may remove separately: one for each joint if the
/// effect acts joint by joint, otherwise the whole entry.
std::vector<EffectRequest> parts_of(const EffectContext& context, const EffectRequest& entry);

/// Effects of a fit that a search may remove, split by parts_of.
std::vector<EffectRequest> removable_effects(const Fit& fit);

}  // namespace armtrue
