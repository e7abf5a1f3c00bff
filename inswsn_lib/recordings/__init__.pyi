from .ins_wsn import (
    INS as INS,
    REFERENCE as REFERENCE,
    TIME as TIME,
    WSN as WSN,
    Recording as Recording,
    read_recording as read_recording,
)
