# add_slow_waves() of terms.cc: sine and cosine from the chain, each wrong by less than 2e-9, doubled
# by products of theirs. w1 … w4: the four fitted amplitudes (Q32), at most 0.125 (checks_terms.cc).
# Bound: 3.7e-9 with all four at that limit.
sn = fixed<-30,ne>(RAW1);
cs = fixed<-30,ne>(RAW2);
sn2 = fixed<-30,ne>(2 * sn * cs);
q2 = fixed<-30,ne>(2 * (sn * sn));
cs2 = 1 - q2;
m1 = fixed<-32,ne>(w1);
m2 = fixed<-32,ne>(w2);
m3 = fixed<-32,ne>(w3);
m4 = fixed<-32,ne>(w4);
slow = fixed<-30,ne>(m1 * sn + m2 * cs + m3 * sn2 + m4 * cs2);
S2 = 2 * S * C;
C2 = 1 - 2 * (S * S);
Slow = w1 * S + w2 * C + w3 * S2 + w4 * C2;

{ w1 in [-0.125,0.125] /\ w2 in [-0.125,0.125] /\ w3 in [-0.125,0.125] /\ w4 in [-0.125,0.125]
  /\ S in [-1,1] /\ C in [-1,1] /\ sn in [-1,1] /\ cs in [-1,1]
  /\ sn - S in [-2e-9,2e-9] /\ cs - C in [-2e-9,2e-9] -> slow - Slow in [-3.7e-9,3.7e-9] }

sn2 - S2 -> (sn2 - 2 * sn * cs) + 2 * ((sn - S) * cs + S * (cs - C));
cs2 - C2 -> -(q2 - 2 * (sn * sn)) - 2 * ((sn - S) * (sn + S));
slow - Slow -> (slow - (m1 * sn + m2 * cs + m3 * sn2 + m4 * cs2))
  + ((m1 - w1) * sn + w1 * (sn - S)) + ((m2 - w2) * cs + w2 * (cs - C))
  + ((m3 - w3) * sn2 + w3 * (sn2 - S2)) + ((m4 - w4) * cs2 + w4 * (cs2 - C2));
