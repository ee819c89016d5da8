// From a fit and the catalogue to the blocks of one search.
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

/// A block at given nonlinear parameters, and what it changes by while those move within their cell
/// of the grid.
struct EvidenceForm {
  Block block;                    ///< its own parameters first, then the slopes
  std::size_t own = 0;            ///< parameters that are no slopes
  std::vector<std::size_t> like;  ///< of each parameter: the own one whose prior size it has
  double log_prior = 0.0;         ///< that the block has this form
  bool halved = false;            ///< its cell of the grid is part of a coarser one
  bool found = false;  ///< of a fit: where its nonlinear parameters stand, with their slopes

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
  bool present = false;       ///< stands in the fit
  bool believed = false;      ///< put into the model by its owner, not by a search
  bool structure = false;     ///< a smooth function that no effect names
  bool unknown_load = false;  ///< springs under masses that nobody knows
  std::size_t finding = 0;    ///< of a structure: which
  double tried = 0.0;  ///< how many like it were looked at before this one was chosen; 0: it alone
  SearchBlock search;
  Eigen::MatrixXd columns;  ///< what `search` is about; empty: to be worked out
};

/// What a search looks at: columns of what is always in the model, and those of the blocks.
struct EvidenceModel {
  Eigen::MatrixXd base;  ///< equations × coefficients of geometry, placement and a user's own terms
  Eigen::MatrixXd base_precision;  ///< of their prior
  Eigen::VectorXd base_pull;       ///< gradient of that prior at the present values
  double base_pull_squares = 0.0;
  Eigen::MatrixXd columns;  ///< equations × columns of all blocks
  Eigen::VectorXd y;        ///< what base (from its present values) and blocks (from zero) explain
  std::vector<EvidenceBlock> blocks;
};

/// What of the catalogue may enter the fit and what of the fit may leave, without columns.
std::vector<EvidenceBlock> evidence_blocks(Fit& fit, const Linearization& linearization,
                                           std::vector<Block> catalogue);

/// Columns and priors of what may enter or leave, and of all else in the fit.
EvidenceModel make_evidence_model(Fit& fit, const Linearization& linearization,
                                  std::vector<EvidenceBlock> blocks);

/// Slopes of blocks with several forms.
void add_all_slopes(const EffectContext& context, std::vector<EvidenceBlock>& blocks);

/// Halves the grid of forms around those that do best, for blocks with several.
void refine_forms(const Fit& fit, std::vector<EvidenceBlock>& blocks, const SearchResult& search);

/// Whether a block that alone explains about as much as any was looked at on the coarse grid only,
/// where it does best.
bool wants_finer_forms(const std::vector<EvidenceBlock>& blocks, const SearchResult& search);

/// An entry of a model as what may leave it: joint by joint where the effect acts joint by joint.
std::vector<EffectRequest> parts_of(const EffectContext& context, const EffectRequest& entry);

/// Effects of a fit that may leave it, as parts_of has them.
std::vector<EffectRequest> removable_effects(const Fit& fit);

}  // namespace armtrue
