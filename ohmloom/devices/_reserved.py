"""Names that a law's parameter cannot have, in lower case: they mean something in emitted text."""

from __future__ import annotations

# Ports, states and variables of the emitted models; temporaries are t0, t1, ...
OWN = "p n x s v i q s0 rate charge_scale inward"

# ISO/IEC 9899:1999, 6.4.1, and the functions of 7.12.
C = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while _bool _complex
_imaginary main asm bool true false null nan infinity
acos asin atan atan2 cos sin tan acosh asinh atanh cosh sinh tanh exp exp2 expm1 frexp ilogb ldexp log log10 log1p
log2 logb modf scalbn scalbln cbrt fabs hypot pow sqrt erf erfc lgamma tgamma ceil floor nearbyint rint lrint llrint
round lround llround trunc fmod remainder remquo copysign nextafter nexttoward fdim fmax fmin fma
isfinite isinf isnan isnormal signbit
"""

# ngspice manual, chapters 2 (numparam) and 5 (behavioural sources); and what other SPICEs predefine.
SPICE = """
time temper temp hertz freq omega gmin vt pi e c kelvin boltz echarge planck no yes params param subckt ends func
model include lib global end ic nodeset options
abs sgn u u2 uramp ln ddt sdt idt nint int sqr pwr pwl min max limit agauss gauss unif aunif arctan ternary_fcn
table stp if and or not
"""

# Accellera Verilog-AMS 2.4, annex B.
VERILOG_A = """
above absdelay absdelta abstol access ac_stim aliasparam always analog analysis assert assign begin branch buf
casex casez cell connect connectmodule connectrules cross ddt_nature ddx deassign defparam design disable discipline
discrete domain driver_update edge electrical endcase endconfig endconnectrules enddiscipline endfunction endgenerate
endmodule endnature endparamset endprimitive endspecify endtable endtask event exclude exclusive_or final_step
flicker_noise flow force forever fork from function generate genvar ground highz0 highz1 idt_nature idtmod ifnone
incdir inf initial initial_step inout input instance integer join laplace_nd laplace_np laplace_zd laplace_zp large
last_crossing liblist library limexp localparam macromodule medium merged module nand nature negedge net_resolution
nmos noise_table nor noshowcancelled notif0 notif1 output parameter paramset pmos posedge potential primitive pull0
pull1 pulldown pullup rcmos real realtime reg release repeat resolveto rnmos rpmos rtran scalared slew small specify
specparam split string strong0 strong1 supply0 supply1 task timer tran transition tri tri0 tri1 triand trior trireg
units use vectored wait wand weak0 weak1 white_noise wire wor wreal xnor xor zi_nd zi_np zi_zd zi_zp
voltage current
"""

RESERVED = frozenset(f"{OWN} {C} {SPICE} {VERILOG_A}".split())
