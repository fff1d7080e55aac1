import glob,sys,time
from pathlib import Path
import numpy as np
from socialiq.recordings.commonroad import read_commonroad
from socialiq.recordings.physics import sift
n=s=0
for f in sorted(glob.glob("/work/shared/data/commonroad/*.xml")):
    t=read_commonroad(Path(f)).recording.tracks
    c=time.process_time(); k,r=sift(t); c=time.process_time()-c
    n+=len(r)
    print(Path(f).stem, t.n_tracks,t.n_states,round(t.n_states/c), *r, sep="\n   " if r else " ")
print(n)
