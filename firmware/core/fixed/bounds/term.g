# add_terms() of terms.cc: coordinate += mantissa * slot / 2^32, rounded.
# slot: a 32-bit integer read as Q30. c: what the mantissa stands for, as Q32 of the coordinate.
# Bound: 0.75 units of the last place (0.7 nrad or nm) for a slot that fills its format.
slot = fixed<-30,ne>(RAW);
m = fixed<-32,ne>(c);
term = fixed<-30,ne>(m * slot);

{ slot in [-2,2] /\ c in [-0.5,0.5] -> term - c * slot in [-7.0e-10,7.0e-10] }

term - c * slot -> (term - m * slot) + (m - c) * slot;
